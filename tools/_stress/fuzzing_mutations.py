"""What is done to a file before a reader gets it: bytes, words, lines, and trees of values."""

from __future__ import annotations

import copy
import functools
import json
import math
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

CANARY = "canary-was-executed"
"""A file's name: code in a file that was run would make it, and the audit would tell."""

LARGEST = 1 << 16  # bytes of an input: readers are tried thousands of times

WORDS: tuple[bytes, ...] = tuple(
    word.encode("utf-8", "surrogatepass")
    for word in (
        *("nan", ".nan", "NaN", "inf", "-.inf", "Infinity", "1e400", "-1e400", "-0", "-0.0", "0"),
        *("1", "-1", "2", "3", "1e-320", "1e308", "1e-5", "0.5", str(2**31), str(2**32 - 1)),
        *(str(2**63), str(-(2**63)), str(2**64), str(10**30), "9" * 5000, "1048576", "100000"),
        *("null", "~", "true", "false", "yes", "0x7fffffff", "0o17", "1_000", "01", "1:30:00"),
        *("2001-01-01", "2001-99-99", "2001-01-01T00:00:00Z", '""', "''", '"1"', "' '", "\\", "."),
        *("../../x", "/etc/passwd", "..", "C:\\x", "file:///x", "con", "a/b/../../../c", "a b"),
        *("\0", "a\0b", "\u2028", "\u202e", "\ufeff", "é", "\ud800", '"\\ud800"', "ß" * 300),
        *("%s%n", "${HOME}", "\r", "\t", "A" * 20000, "'" + "A" * 300 + "'", "[]", "{}", "[[]]"),
        *("[1, 2]", "[null]", "{a: 1}", '{"a": {"b": []}}', "[" * 10000, '{"a":' * 5000),
        *("{a: " * 2000, "[" * 600 + "]" * 600, "- " * 5000, "? " * 500, "a." * 3000 + "b = 1"),
        *(" " * 5000, "\n" * 20000, "\n\n", " \n" * 2000, "a " * 5000, "1 " * 5000, "1\n" * 5000),
        *(
            "<<",
            "<<: *a",
            "&a [1]",
            "*a",
            "!!binary aGk=",
            "!!set {a}",
            "!!timestamp x",
            "!!int x",
        ),
        *("!!float []", "!!omap [a: 1]", "!!null a", "!!str 1", "!!map []", "!!bool 1", "!x a"),
        *(
            "!!python/name:os.system",
            "!!python/module:os",
            "!!python/tuple [1]",
            "---",
            "...",
            "|",
        ),
        *("%YAML 1.1\n---\n", "!!opencv-matrix", ": ", "# ", "= ", "<!DOCTYPE a>", "<a>" * 3000),
        f"!!python/object/apply:os.system ['touch {CANARY}']",
        f"!!python/object/new:type [a, [], {{extend: !!python/name:exec }}]  # {CANARY}",
        "&a [x, x, x, x], &b [*a, *a, *a, *a], &c [*b, *b, *b, *b], &d [*c, *c, *c, *c]",
        '<?xml version="1.0" encoding="utf-16"?>',
        '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;&b;">]>',
    )
)
"""Values that readers stumble over: numbers, paths, nesting, YAML's tags and aliases, blanks."""

_SHORT = tuple(word for word in WORDS if len(word) <= 1000)
_LONG = tuple(word for word in WORDS if len(word) > 1000)
_SELDOM = 0.03

VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 3, 7, 255, 65536, 2**31, 2**53, 2**63, 10**30, -(2**64)),
    *(0.5, -0.0, 1e-320, 1e308, 1e300, math.nan, math.inf, -math.inf, "", " ", "x", "1", "nan"),
    *("../../x", "/etc/passwd", "a\0b", "\ud800", "a\nb", "\u2028", "A" * 3000, "1e5", "1.5"),
    *([], {}, [[]], [None], [1], [1, 2], [1, 2, 3], [1, 2, 3, 4], [0] * 5, [0.1] * 8, [0] * 12),
    *([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0] * 3] * 3, [[0] * 4] * 4, ["a"] * 3, [[1], [2, 3]]),
    *({"a": 1}, {"": None}, {"rows": 3, "cols": 3, "data": [1] * 9}, {"rows": 10**9, "cols": 1}),
    *([1e200] * 3, [1e-200] * 3, [[1e200] * 3] * 3, [100000, 100000], [2**20, 2**20], [16, 1]),
)
"""Values for the leaves and branches of a tree."""

_NUMBERS = (0, 1, 2, 3, 4, 7, 8, 15, 16, 32, 64, 127, 128, 255, 256, 257, 1000, 4095, 32767, 32768)
_NUMBERS += (65535, 65536, 2**20, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)

Mutation = Callable[[bytes, Random, Sequence[bytes]], bytes]
"""``mutation(data, rng, corpus)`` returns another input."""


def flip(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Change some bytes."""
    changed = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        at = _place(len(changed), rng)
        changed[at] = rng.choice((changed[at] ^ (1 << rng.randrange(8)), rng.randrange(256)))
    return bytes(changed)


def overwrite(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Write a number that headers are afraid of over a few bytes."""
    size = rng.choice((1, 2, 4, 8))
    number = rng.choice(_NUMBERS) & ((1 << 8 * size) - 1)
    at = _place(len(data), rng)
    order = rng.choice(("little", "big"))
    return data[:at] + number.to_bytes(size, order) + data[at + size :]


def truncate(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Keep a beginning, or lose one."""
    at = _place(len(data), rng)
    return data[at:] if rng.random() < 0.2 else data[:at]


def cut(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Lose a piece."""
    at = _place(len(data), rng)
    return data[:at] + data[at + rng.choice((1, 2, 4, 8, 16, 64, 256)) :]


def repeat(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Have a piece several times."""
    at = _place(len(data), rng)
    piece = data[at : at + rng.choice((1, 2, 8, 40, 200))]
    return data[:at] + piece * rng.choice((2, 3, 10, 1000)) + data[at:]


def splice(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Go on with another input."""
    other = rng.choice(corpus)
    return data[: _place(len(data), rng)] + other[_place(len(other), rng) :]


def insert_word(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Put a hostile word anywhere."""
    at = _place(len(data), rng)
    return data[:at] + _word(rng) + data[at:]


def replace_word(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Replace a number or a word by a hostile one, or by another of the file."""
    found = list(re.finditer(rb"[-+.\w/]+", data[:8192]))
    if not found:
        return insert_word(data, rng, corpus)
    for match in sorted(rng.sample(found, min(len(found), rng.choice((1, 1, 2)))), key=_backward):
        word = _word(rng) if rng.random() < 0.75 else rng.choice(found).group()
        if len(word) > 8192 and len(data) > LARGEST:
            continue
        data = data[: match.start()] + word + data[match.end() :]
    return data


def change_lines(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Drop, double, swap, move or join lines."""
    lines = data.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(other, lines[at])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at] = b" " * rng.choice((1, 2, 8)) + lines[at]
    elif kind == 4:
        lines[at] = lines[at].lstrip()
    else:
        lines[at] = lines[at] * rng.choice((2, 100))
    return b"\n".join(lines)


def change_tree(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Change one value of a JSON or YAML file: replaced, dropped, doubled, wrapped, renamed."""
    tree = json.loads(_as_json(data))
    if not isinstance(tree, (dict, list)):
        return replace_word(data, rng, corpus)
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(_places(tree))
        if places:
            _change(*rng.choice(places), rng, places)
    text = json.dumps(tree)
    return (text if rng.random() < 0.9 else text.replace("{", "{\n")).encode()


TEXT: tuple[Mutation, ...] = (
    *(replace_word, replace_word, replace_word, change_lines, change_lines, insert_word),
    *(flip, cut, repeat, truncate, splice),
)
TREE: tuple[Mutation, ...] = (change_tree, change_tree, change_tree, change_tree, *TEXT)
BINARY: tuple[Mutation, ...] = (flip, flip, overwrite, overwrite, overwrite, cut, repeat, truncate)
BINARY += (splice,)


def mutated(
    data: bytes, rng: Random, corpus: Sequence[bytes], mutations: Sequence[Mutation]
) -> bytes:
    """Return ``data`` after one to four mutations."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        data = rng.choice(mutations)(data, rng, corpus)
    return data[:LARGEST]


def _word(rng: Random) -> bytes:
    """Return a hostile word; long ones take time, and seldom show more than once."""
    return rng.choice(_LONG if rng.random() < _SELDOM else _SHORT)


def _place(length: int, rng: Random) -> int:
    """Return a place, more often near the beginning, where headers are."""
    if length < 2:
        return 0
    return rng.randrange(min(length, 512)) if rng.random() < 0.5 else rng.randrange(length)


def _backward(match: re.Match) -> int:
    return -match.start()


@functools.lru_cache(maxsize=256)
def _as_json(data: bytes) -> str:
    """Return a small JSON or YAML file as JSON; ``null`` where it is neither.

    Most inputs are made of one that was changed before.
    """
    import yaml

    if len(data) > 20000 or any(data.count(c) > 2000 for c in b"[{"):
        return "null"
    try:
        return json.dumps(json.loads(data))
    except (ValueError, RecursionError):
        pass
    try:
        return json.dumps(yaml.load(data, getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except Exception:  # what is broken is changed as text
        return "null"


def _places(tree: Any) -> Any:
    """Yield every container with each of its keys, outermost first."""
    waiting = [tree]
    for container in waiting:
        keys = container if isinstance(container, dict) else range(len(container))
        for key in list(keys)[:64]:
            yield container, key
            if isinstance(container[key], (dict, list)) and len(waiting) < 500:
                waiting.append(container[key])


def _change(container: Any, key: Any, rng: Random, places: list) -> None:
    """Change what stands at a place of a tree."""
    if isinstance(container, list) and key >= len(container):
        return  # an earlier change made the list shorter
    if isinstance(container, dict) and key not in container:
        return
    kind = rng.randrange(10)
    value = container[key]
    if kind < 5:
        container[key] = copy.deepcopy(rng.choice(VALUES))
    elif kind == 5:
        del container[key]
    elif kind == 6 and isinstance(container, list):
        container[key:key] = [value] * rng.choice((1, 1, 2, 500))
    elif kind == 6:
        container[rng.choice(("", "a", "name", "1", "R", "x y", "é"))] = container.pop(key)
    elif kind == 7:
        container[key] = rng.choice(([value], [[value]], {"a": value}, {"value": value}))
    elif kind == 8:
        other, name = rng.choice(places)
        if not isinstance(other, list) and name in other:
            container[key] = json.loads(json.dumps(other[name]))
    else:
        depth = rng.choice((2, 40, 300))
        for _ in range(depth):
            value = [value]
        container[key] = value
