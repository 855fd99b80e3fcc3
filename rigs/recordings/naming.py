"""Patterns of names, found from the names: where a path has its camera, and where its frame."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import PurePosixPath

from rigs.recordings.layout import ONLY, natural

Named = dict[str, dict[str, PurePosixPath]]
"""Camera to frame to path."""

_CAMERA, _FRAME, _NUMBER = "{camera}", "{frame}", "*"
_Part = tuple[str, str]
"""A part of a path: its kind, or a text that all paths of a pattern share, and its text."""


def patterns_of(paths: Iterable[PurePosixPath], cameras: Sequence[str]) -> dict[str, Named]:
    """Return the patterns that paths are named by, and camera to frame to path by each.

    A camera's name stands between signs that are no letters or digits. It is a folder, whose
    files are then called by their frames, or in a file's name, whose last number is the frame.
    Numbers that differ beside it, such as the time of day, are ``*``. A folder with a number that
    differs between files called by their cameras is the frame. Two patterns never give the same
    paths to the same cameras and frames.

    >>> paths = [PurePosixPath(f"run/left/{n}.tif") for n in ("01", "02")]
    >>> {pattern: list(found["left"]) for pattern, found in patterns_of(paths, ["left"]).items()}
    {'run/{camera}/{frame}.tif': ['01', '02']}
    """
    names = sorted(cameras, key=len, reverse=True)
    one_of = re.compile(rf"(?<![^\W_])(?:{'|'.join(map(re.escape, names))})(?![^\W_])")
    groups: dict[tuple[str, ...], list[tuple[list[_Part], PurePosixPath]]] = {}
    for path in paths:
        for parts in _readings(path, one_of) if cameras else ():
            groups.setdefault(tuple(kind for kind, _ in parts), []).append((parts, path))
    found: dict[str, Named] = {}
    for members in _joined(groups):
        pattern, named = _pattern(members)
        if named and named not in found.values():
            found[pattern] = named
    return found


def _readings(path: PurePosixPath, one_of: re.Pattern[str]) -> Iterator[list[_Part]]:
    """Yield the parts of a path for each camera that may have written it."""
    text = path.as_posix()
    places = list(one_of.finditer(text))
    for camera in dict.fromkeys(place[0] for place in places):
        own = [place.span() for place in places if place[0] == camera]
        parts: list[_Part] = []
        at = 0
        for number, (start, end) in enumerate(own):
            parts += [(text[at:start], text[at:start]), (_NUMBER if number else _CAMERA, camera)]
            at = end
        parts.append((text[at:], text[at:]))
        yield [part for part in _with_frame(parts, path.suffix) if part[0]]


def _with_frame(parts: list[_Part], suffix: str) -> Iterator[_Part]:
    """Yield the parts of a path, those of its file's name with their frame and their numbers."""
    last = max(n for n, (_, text) in enumerate(parts) if n == 0 or "/" in text)
    folder, slash, rest = parts[last][1].rpartition("/")
    is_whole = last == len(parts) - 1 and any(kind == _CAMERA for kind, _ in parts[:last])
    yield from parts[:last]
    yield f"{folder}{slash}", f"{folder}{slash}"
    if is_whole:  # the camera is a folder: all of the file's name is the frame's
        yield _FRAME, rest.removesuffix(suffix)
        yield suffix, suffix
        return
    words: list[_Part] = []
    for kind, text in [(rest, rest), *parts[last + 1 :]]:
        if kind in (_CAMERA, _NUMBER):
            words.append((kind, text))
            continue
        is_end = text is parts[-1][1] or not parts[last + 1 :]
        text = text.removesuffix(suffix) if is_end else text
        for piece in re.split(r"(\d+)", text):
            words.append((_NUMBER if piece.isdecimal() else piece, piece))
    numbers = [n for n, (kind, text) in enumerate(words) if kind == _NUMBER and text.isdecimal()]
    if numbers:
        words[numbers[-1]] = (_FRAME, words[numbers[-1]][1])
    yield from words
    yield suffix, suffix


def _joined(
    groups: dict[tuple[str, ...], list[tuple[list[_Part], PurePosixPath]]],
) -> Iterator[list[tuple[list[_Part], PurePosixPath]]]:
    """Yield the members of groups; those whose folder alone differs are frames of one pattern."""

    def other_than_folder(kinds: tuple[str, ...]) -> tuple[str, ...]:
        return (kinds[0].count("/") * "/", *kinds[1:])

    def is_frame(kinds: tuple[str, ...]) -> bool:
        return _FRAME not in kinds and kinds[0].endswith("/")

    ordered = sorted(groups, key=lambda kinds: (is_frame(kinds), other_than_folder(kinds)))
    for (one_frame, _), each in groupby(ordered, lambda k: (is_frame(k), other_than_folder(k))):
        alike = list(each)
        folders = [kinds[0].rstrip("/").split("/") for kinds in alike]
        differ = [n for n, names in enumerate(zip(*folders, strict=False)) if len(set(names)) > 1]
        is_number = all(re.search(r"\d", names[at]) for at in differ for names in folders)
        if not one_frame or len(differ) != 1 or not is_number:
            yield from (groups[kinds] for kinds in alike)
            continue
        at = differ[0]
        members = []
        for kinds, names in zip(alike, folders, strict=True):
            before = "".join(f"{name}/" for name in names[:at])
            after = "".join(f"/{name}" for name in names[at + 1 :]) + "/"
            head = [(before, before), (_FRAME, names[at]), (after, after)]
            members += [
                ([part for part in head if part[0]] + parts[1:], path)
                for parts, path in groups[kinds]
            ]
        yield members


def _pattern(members: list[tuple[list[_Part], PurePosixPath]]) -> tuple[str, Named]:
    """Return the pattern of paths of the same kinds, and the paths by camera and frame."""
    kinds = [kind for kind, _ in members[0][0]]
    texts = list(zip(*([text for _, text in parts] for parts, _ in members), strict=True))
    written = [
        each[0] if kind == _NUMBER and len(set(each)) == 1 else kind
        for kind, each in zip(kinds, texts, strict=True)
    ]
    frames = texts[kinds.index(_FRAME)] if _FRAME in kinds else [ONLY] * len(members)
    named: Named = {}
    for camera, frame, (_, path) in zip(texts[kinds.index(_CAMERA)], frames, members, strict=True):
        own = named.setdefault(camera, {})
        if frame in own:
            return "".join(written), {}
        own[frame] = path
    ordered = {
        camera: dict(sorted(named[camera].items(), key=lambda item: natural(item[0])))
        for camera in sorted(named, key=natural)
    }
    return "".join(written), ordered
