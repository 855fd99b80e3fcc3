"""Reading and writing text files, YAML and JSON; errors name the file, writes are atomic."""

from __future__ import annotations

import datetime
import difflib
import json
import math
import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rigs.files.atomic import atomic_path

AT_ONCE = 16 * 2**20
"""Bytes of a foreign file that are held at a time: a text, or a line of COLMAP's, which holds all
points of an image; a piece that is unpacked; the ends of an HDF5 file, where its texts stand."""

END = 1 << 16  # bytes at an end of a file that say what is in it
FEW = 6  # names in a message; more make the line too long
MAX_DEPTH = 32  # levels of nesting; foreign files need below ten, and deeper trees cost a stack
_MAX_VALUES = 1_000_000  # of a YAML file: 8 cameras and 45,000 frames have almost as many

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def expected_one_of(found: str, known: Iterable[str]) -> str:
    """Return what was meant, if a known word is like it, else all known words.

    >>> expected_one_of("curvatur", ("art", "curvature"))
    'did you mean curvature?'
    """
    known = tuple(known)
    near = nearest(found, known)
    return f"did you mean {near}?" if near else f"expected one of {', '.join(known)}"


def nearest(found: str, known: Sequence[str]) -> str | None:
    """Return the known word that a misspelt one is like; None if there is none."""
    near = difflib.get_close_matches(found, known, n=1)
    return near[0] if near else None


def read_text(path: str | os.PathLike) -> str:
    """Return the UTF-8 text of a file; ValueError where it is another or larger than 16 MiB."""
    with _existing(path).open("rb") as file:
        data = file.read(AT_ONCE + 1)
    if len(data) > AT_ONCE:
        raise ValueError(f"{path}: found more than {AT_ONCE >> 20} MiB, expected a text file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: found a byte not UTF-8 at {error.start}, expected text"
        ) from None


def iter_lines(path: str | os.PathLike, keep_empty: bool = False) -> Iterator[str]:
    """Yield a text's lines, of any size, stripped; empty ones only with ``keep_empty``.

    For formats whose few cameras stand among millions of points.
    """
    with _existing(path).open("rb") as file:
        number = 0
        while line := file.readline(AT_ONCE + 1):
            number += 1
            if len(line) > AT_ONCE:
                raise ValueError(
                    f"{path}: found a line {number} of more than {AT_ONCE >> 20} MiB, expected "
                    "a text file"
                )
            try:
                text = line.decode("utf-8-sig" if number == 1 else "utf-8").strip()
            except UnicodeDecodeError:
                raise ValueError(
                    f"{path}: found bytes not UTF-8 in line {number}, expected text"
                ) from None
            if text or keep_empty:
                yield text


def _existing(path: str | os.PathLike) -> Path:
    """Return the path of a file, or raise because there is none."""
    path = Path(path)
    try:
        is_folder, exists = path.is_dir(), path.exists()
    except OSError as error:  # a name that is too long
        raise ValueError(f"{path}: found no file's name: {error.strerror}") from None
    if is_folder:
        raise IsADirectoryError(f"{path}: found a folder, expected a file")
    if not exists:
        raise FileNotFoundError(f"{path}: no such file")
    check_plain_file(path)
    return path


def check_plain_file(path: str | os.PathLike) -> None:
    """Raise where there is something else than a file or folder: reading a pipe may never end."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return  # whoever opens it says why it cannot
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise ValueError(f"{path}: found a pipe or device, expected a file")


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write ``text`` as UTF-8: see `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | os.PathLike, data: bytes) -> None:
    """Write ``data`` under a temporary name in the same folder, then rename it.

    Missing folders are made.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def some(names: Iterable[str], most: int = FEW) -> str:
    """Return a list of names, cut where it is long."""
    names = list(names)
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    return ", ".join(names)


def shortened(value: object) -> str:
    """Return what was found in at most 60 characters, for a message."""
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def breaks_a_line(text: str) -> bool:
    """Return whether a text holds a line break, also as its last character."""
    return text.splitlines() not in ([], [text])


def read_yaml_mapping(path: str | os.PathLike) -> dict[str, Any]:
    """Return the plain data of a YAML file whose top level is a mapping; dates become text.

    Aliases, a few lines of which may expand to any amount of data, and repeated keys are refused.
    """
    return yaml_mapping(read_text(path), path)


def yaml_mapping(text: str, path: str | os.PathLike) -> dict[str, Any]:
    """Return the plain data of ``text``, which was read from ``path``: see `read_yaml_mapping`."""
    try:
        _check_events(text, path)
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is not None:
                _check_nodes(node, path)
            data = None if node is None else loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        where = f" at line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ValueError(f"{path}: broken YAML{where}: {error.problem}") from None
    except RecursionError:
        raise ValueError(f"{path}: broken YAML: nested too deeply") from None
    except Exception as error:  # tags make PyYAML raise half a dozen kinds: !!int without digits
        if str(error).startswith(f"{path}: "):
            raise
        raise ValueError(f"{path}: broken YAML: {' '.join(str(error).split())}") from None
    if data is None:
        raise ValueError(f"{path}: found an empty file, expected a YAML mapping")
    if not isinstance(data, dict):
        raise ValueError(f"{path}: found {_kind(data)}, expected a YAML mapping: length_unit: mm")
    return _plain(data)


def read_json(path: str | os.PathLike) -> Any:
    """Return the data of a JSON file."""
    text = read_text(path)
    if not text.strip():
        raise ValueError(f"{path}: found an empty file, expected JSON")
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(f"{path}: broken JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{path}: broken JSON: {error}") from None


def read_json_mapping(path: str | os.PathLike) -> dict[str, Any]:
    """Return the data of a JSON file whose top level is an object."""
    data = read_json(path)
    if not isinstance(data, dict):
        raise ValueError(f"{path}: found {_kind(data)}, expected a JSON object")
    return data


def _kind(data: object) -> str:
    """Return what plain data is, in words."""
    words = {list: "a list", str: "text", bool: "true or false", type(None): "nothing"}
    return words.get(type(data), "a number")


def _check_events(text: str, path: str | os.PathLike) -> None:
    """Refuse aliases, deep nesting and too many values before values are built."""
    # nodes are built by recursion in C, which overflows the stack at some ten thousand levels
    depth, values = 0, 0
    anchors: dict[str | None, int] = {}
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if not isinstance(event, yaml.NodeEvent):
            continue
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent):
            line = anchors.get(event.anchor, line)
            raise ValueError(f"{path}: found a YAML alias to line {line}, expected plain values")
        anchors[event.anchor] = line
        values += 1
        if values > _MAX_VALUES:
            raise ValueError(f"{path}: found more than {_MAX_VALUES} values, expected fewer")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise ValueError(f"{path}: broken YAML at line {line}: nested too deeply")


def _check_nodes(root: yaml.Node, path: str | os.PathLike) -> None:
    """Refuse repeated keys; keys become text as written: cameras and frames are called 01."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        line = node.start_mark.line + 1
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
        elif isinstance(node, yaml.MappingNode):
            keys = set()
            for key, value in node.value:
                if not isinstance(key, yaml.ScalarNode):
                    raise ValueError(f"{path}: broken YAML, line {line}: a key is not plain text")
                if key.value in keys:
                    name = " ".join(key.value.split())[:60]
                    raise ValueError(
                        f"{path}: {name}: found twice in one mapping, again at line "
                        f"{key.start_mark.line + 1}"
                    )
                keys.add(key.value)
                key.tag = "tag:yaml.org,2002:str"
                waiting.append(value)


def _plain(value: Any) -> Any:
    """Return ``value`` with dates as text."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [_plain(item) for item in value]
    if isinstance(value, (datetime.date, datetime.datetime)):
        return value.isoformat()
    if isinstance(value, bytes):
        return value.hex()
    return value


def plain(value: Any, digits: int | None = None) -> Any:
    """Return data as JSON holds it: text keys, lists, null for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner, digits) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner, digits) for inner in value]
    if hasattr(value, "item"):
        value = value.item()
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return value if digits is None else float(f"{value:.{digits}g}")


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    """Write plain data to a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=indent) + "\n", "utf-8")
