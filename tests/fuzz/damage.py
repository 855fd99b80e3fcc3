"""Hypothesis strategies that damage a file: its bytes, words, lines, values and members."""

import copy
import functools
import io
import json
import math
import re
import struct
import zipfile
import zlib

import hypothesis.strategies as st
import yaml

LARGEST = 1 << 16  # bytes of a file: a reader is tried thousands of times
NUMBERS = (0, 1, 2, 7, 16, 127, 255, 256, 32767, 65535, 2**20, 2**24, 2**31 - 1, 2**31)
NUMBERS += (2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
WORDS = tuple(
    word.encode("utf-8", "surrogatepass")
    for word in (
        *("nan", ".nan", "inf", "-.inf", "Infinity", "1e400", "-0.0", "0", "1", "-1", "1e-320"),
        *("1e308", "0.5", str(2**31), str(2**63), str(10**30), "9" * 5000, "100000", "null", "~"),
        *("true", "yes", "0x7fffffff", "0o17", "1_000", "01", "1:30:00", '""', "' '", "file:///x"),
        *("2001-01-01", "2001-99-99", "2001-01-01T00:00:00Z", "\\", "../../x", "/etc/passwd"),
        *("..", "a b", "\0", "a\0b", "\u2028", "\u202e", "\ufeff", "é", "\ud800", "\r", "\t"),
        *("A" * 20000, "[]", "{}", "[[]]", "[1, 2]", "[null]", "{a: 1}", "[" * 10000, "- " * 5000),
        *('{"a":' * 5000, "{a: " * 2000, "? " * 500, "a." * 3000 + "b = 1", "\n" * 20000),
        *("a " * 5000, "1\n" * 5000, " \n" * 2000, "<<: *a", "&a [1]", "*a", "!!binary aGk="),
        *("!!float []", "!!omap [a: 1]", "!!python/name:os.system", "!!python/tuple [1]", "---"),
        *("|", "%YAML 1.1\n---\n", "!!opencv-matrix", ": ", "# ", "= ", "!!set {a}", "<a>" * 3000),
        "!!python/object/apply:os.mkdir [executed]",
        "&a [x, x, x, x], &b [*a, *a, *a, *a], &c [*b, *b, *b, *b], &d [*c, *c, *c, *c]",
        '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;&b;">]>',
    )
)
"""Words that readers stumble over: numbers, paths, nesting, tags and aliases of YAML, blanks."""

VALUES = (
    *(None, True, False, 0, -1, 1, 2, 3, 255, 65536, 2**31, 2**63, 10**30, -(2**64), 0.5, -0.0),
    *(1e-320, 1e308, math.nan, math.inf, -math.inf, "", " ", "x", "1", "nan", "../../x"),
    *("/etc/passwd", "a\0b", "\ud800", "a\nb", "\u2028", "A" * 3000, [], {}, [[]], [None], [1]),
    *([1, 2], [1, 2, 3], [0] * 5, [0.1] * 8, [0] * 12, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    *([[0] * 3] * 3, [[0] * 4] * 4, ["a"] * 3, [[1], [2, 3]], {"a": 1}, {"": None}, [1e200] * 3),
    *([[1e200] * 3] * 3, [100000, 100000], [2**20, 2**20], {"rows": 10**9, "cols": 1}),
    *({"rows": 3, "cols": 3, "data": [1] * 9},),
)
"""Values for the leaves and branches of a tree."""


def place(draw, content):
    """Return a place in a file, more often near its beginning, where headers are."""
    length = len(content)
    return draw(st.one_of(st.integers(0, min(length, 256)), st.integers(0, length)))


def flip(draw, content):
    """Change some bytes."""
    changed = bytearray(content or b"\0")
    for _ in range(draw(st.sampled_from((1, 1, 2, 8)))):
        changed[min(place(draw, changed), len(changed) - 1)] = draw(st.integers(0, 255))
    return bytes(changed)


def overwrite(draw, content):
    """Write a number that headers are afraid of over a few bytes."""
    size = draw(st.sampled_from((1, 2, 4, 8)))
    number = draw(st.sampled_from(NUMBERS)) & ((1 << 8 * size) - 1)
    at, order = place(draw, content), draw(st.sampled_from(("little", "big")))
    return content[:at] + number.to_bytes(size, order) + content[at + size :]


def cut(draw, content):
    """Lose a piece: the end, the beginning, or some bytes between."""
    at, count = place(draw, content), draw(st.sampled_from((1, 2, 8, 64, LARGEST)))
    return content[at:] if draw(st.integers(0, 9)) == 0 else content[:at] + content[at + count :]


def repeat(draw, content):
    """Have a piece several times."""
    at = place(draw, content)
    piece = content[at : at + draw(st.sampled_from((1, 2, 8, 40, 200)))]
    return content[:at] + piece * draw(st.sampled_from((2, 3, 10, 1000))) + content[at:]


def replace_word(draw, content):
    """Put a hostile word in the place of a number or word of the file, or anywhere."""
    found = list(re.finditer(rb"[-+.\w/]+", content[:8192]))
    word = draw(st.sampled_from(WORDS))
    if not found or draw(st.integers(0, 7)) == 0:
        at = place(draw, content)
        return content[:at] + word + content[at:]
    match = draw(st.sampled_from(found))
    return content[: match.start()] + word + content[match.end() :]


def change_lines(draw, content):
    """Drop, double, swap or indent lines."""
    lines = content.split(b"\n")
    at, other = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    kind = draw(st.integers(0, 4))
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(other, lines[at])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at] = b"  " + lines[at]
    else:
        lines[at] = lines[at] * 100
    return b"\n".join(lines)


def change_tree(draw, content):
    """Change values of a JSON or YAML file: replaced, dropped, doubled, wrapped or renamed."""
    tree = json.loads(as_json(content))
    if not isinstance(tree, dict | list):
        return replace_word(draw, content)
    places, waiting = [], [tree]
    for container in waiting:
        for key in container if isinstance(container, dict) else range(len(container)):
            places.append((container, key))
            if isinstance(container[key], dict | list):
                waiting.append(container[key])
    if not places:
        return replace_word(draw, content)
    container, key = draw(st.sampled_from(places))
    value, kind = container[key], draw(st.integers(0, 7))
    if kind < 4:
        container[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
    elif kind == 4:
        del container[key]
    elif kind == 5 and isinstance(container, list):
        container[key:key] = [value] * draw(st.sampled_from((1, 2, 500)))
    elif kind == 5:
        container[draw(st.sampled_from(("", "a", "name", "1", "R", "x y")))] = container.pop(key)
    elif kind == 6:
        for _ in range(draw(st.sampled_from((1, 2, 40, 300)))):
            value = [value]
        container[key] = value
    else:
        container[key] = draw(st.sampled_from(({"a": value}, {"value": value})))
    return json.dumps(tree).encode()


def change_member(draw, content):
    """Change a member of an archive and pack it again, so that the check sums are right."""
    members = unpacked(content)
    if not members:
        return flip(draw, content)
    name, kind = draw(st.sampled_from(sorted(members))), draw(st.integers(0, 5))
    if kind == 0:
        del members[name]
    elif kind == 1:
        other = draw(st.sampled_from(("../../x.npy", "/x.npy", "x", f"{name}x")))
        members[other] = members[name]
    else:
        change = draw(st.sampled_from((flip, overwrite, cut, repeat, replace_word, replace_word)))
        members[name] = change(draw, members[name])
    return packed(members)


def change_chunk(draw, content):
    """Change a chunk of a PNG and give it the right check sum."""
    chunks, at = [], 8
    while at + 12 <= len(content) and content.startswith(b"\x89PNG"):
        (length,) = struct.unpack(">I", content[at : at + 4])
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    if not chunks:
        return flip(draw, content)
    number, kind = draw(st.integers(0, len(chunks) - 1)), draw(st.integers(0, 3))
    name, data = chunks[number]
    if kind == 0:
        del chunks[number]
    elif kind == 1:
        chunks.insert(0, chunks[number])
    elif name == b"IDAT" and kind == 2:
        try:
            rows = zlib.decompressobj().decompress(data, 1 << 20)
        except zlib.error:  # an earlier change broke it
            rows = bytes(70)
        chunks[number] = name, zlib.compress(draw(st.sampled_from((flip, cut)))(draw, rows))
    else:
        chunks[number] = name, draw(st.sampled_from((flip, overwrite)))(draw, data)
    return png(chunks)


BINARY = (flip, overwrite, overwrite, cut, repeat)
TEXT = (replace_word, replace_word, change_lines, flip, cut, repeat)
TREE = (change_tree, change_tree, change_tree, *TEXT)
ARCHIVE = (change_member, change_member, *BINARY)
PNG = (change_chunk, change_chunk, *BINARY)


@st.composite
def damaged(draw, samples, changes):
    """Draw one of the valid files after one to three changes.

    Parameters
    ----------
    samples : sequence of bytes
    changes : sequence of callable
        ``change(draw, content)`` returns other content.
    """
    content = draw(st.sampled_from(samples))
    for _ in range(draw(st.sampled_from((1, 1, 2, 3)))):
        content = draw(st.sampled_from(changes))(draw, content)[:LARGEST]
    return content


@functools.lru_cache(maxsize=256)
def as_json(content):
    """Return a small JSON or YAML file as JSON; ``null`` where it is neither."""
    if len(content) > 20_000 or any(content.count(c) > 500 for c in b"[{-"):
        return "null"
    try:
        return json.dumps(json.loads(content))
    except (ValueError, RecursionError):
        pass
    try:
        return json.dumps(yaml.safe_load(content))
    except Exception:  # what is broken is changed as text
        return "null"


def unpacked(content):
    """Return the members of a small archive; none where it is broken."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            return {item.filename: file.read(item) for item in file.infolist()}
    except Exception:  # an archive that an earlier change broke
        return {}


def packed(members):
    """Return an archive that stores its members as they are."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), data)
    return file.getvalue()


def png(chunks):
    """Return a PNG of chunks."""
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in chunks:
        check = zlib.crc32(name + data)
        content += struct.pack(">I", len(data)) + name + data + struct.pack(">I", check)
    return content
