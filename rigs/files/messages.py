"""One-line messages for what a schema refuses, in the file's own names of fields."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import pydantic

from rigs.files.text import FEW, expected_one_of, shortened

_PLAIN = {float: "number", int: "whole number", str: "text"}
_REPORTED_FIRST = {"literal_error": 0, "extra_forbidden": 1}


def first_problem(
    error: pydantic.ValidationError, model: type[pydantic.BaseModel], data: Mapping[str, Any]
) -> tuple[list[str | int], str]:
    """Return the path in ``data`` of the first problem, and what was found and expected there.

    The most specific one: another format or version, then unknown fields, then missing ones.
    """
    problems = error.errors(include_url=False)
    problem = min(
        problems, key=lambda found: _REPORTED_FIRST.get(found["type"], len(_REPORTED_FIRST))
    )
    path = _path(problem["loc"], data, is_missing=problem["type"] == "missing")
    return path, _message(problem, path, model)


def dotted(path: Sequence[str | int]) -> str:
    """Return the dotted form of a path, like ``distortion.coefficients[3]``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text.encode("unicode_escape").decode()


def _path(loc: Sequence[str | int], data: Any, is_missing: bool) -> list[str | int]:
    """Return the steps of pydantic's path that the data has, without pydantic's names of types."""
    path: list[str | int] = []
    for step, part in enumerate(loc):
        is_item = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if is_item or (isinstance(data, dict) and part in data):
            path.append(part)
            data = data[part]
        elif is_missing and step == len(loc) - 1:
            path.append(part)
    return path


def _message(problem: Mapping[str, Any], path: list[str | int], model: type) -> str:
    if problem["type"] == "extra_forbidden":
        known = list(_annotation_at(model, path[:-1]).model_fields)
        return f"unknown field, {expected_one_of(str(path[-1]), known)}"
    if problem["type"] == "missing":
        if isinstance(path[-1], int):  # a tuple that is too short
            count = path.pop()
            values = "value" if count == 1 else "values"
            return f"found {count} {values}, expected {_in_words(_annotation_at(model, path))}"
        return f"missing, expected {_in_words(_annotation_at(model, path))}"
    annotation = _annotation_at(model, path)
    if problem["type"] == "value_error" and len(_choices(annotation)) == 1:
        expected = str(problem["ctx"]["error"])
        if ": found " in f": {expected}":  # a complete message
            return expected
    else:
        expected = _in_words(annotation)
    return f"found {shortened(problem['input'])}, expected {expected}"


def _annotation_at(model: Any, path: Sequence[str | int]) -> Any:
    """Return the type annotation of a schema at a path."""
    here = model
    for part in path:
        for choice in _choices(here):
            is_model = isinstance(choice, type) and issubclass(choice, pydantic.BaseModel)
            if is_model and part in choice.model_fields:
                here = choice.model_fields[part].annotation
                break
            inner = typing.get_args(choice)
            if inner and (isinstance(part, int) or typing.get_origin(choice) is dict):
                here = inner[-1]
                break
    return _choices(here)[0] if len(_choices(here)) == 1 else here


def _choices(annotation: Any) -> list[Any]:
    """Return the alternatives of a type annotation, without None."""
    origin = typing.get_origin(annotation)
    if origin is Annotated:
        return _choices(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        return [
            choice
            for one in typing.get_args(annotation)
            if one is not type(None)
            for choice in _choices(one)
        ]
    return [annotation]


def _in_words(annotation: Any) -> str:
    """Return a type annotation in words, like ``a number or a list of 3 numbers``."""
    return " or ".join(_one_in_words(choice) for choice in _choices(annotation))


def _one_in_words(annotation: Any, plural: bool = False) -> str:
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Literal:
        return " or ".join(str(value) for value in inner)
    if annotation is str:
        return "text"
    many = "s" if plural else ""
    word = f"{_PLAIN.get(annotation, 'mapping')}{many}"
    if isinstance(annotation, type) and issubclass(annotation, pydantic.BaseModel):
        fields = tuple(annotation.model_fields)
        word += f" with {', '.join(fields)}" if len(fields) <= FEW and not plural else ""
    if origin in (tuple, list):
        count = f"{len(inner)} " if origin is tuple else ""
        item = _choices(inner[0])[0]
        word = f"list{many} of {count}{_one_in_words(item, plural=True)}"
    return word if plural else f"a {word}"
