"""Files inside files: zip archives, NumPy headers, pickles, PNG chunks; and bombs of them."""

from __future__ import annotations

import functools
import io
import os
import pickle
import struct
import zipfile
import zlib
from collections.abc import Sequence
from random import Random

import numpy as np

from _stress.fuzzing_mutations import BINARY, CANARY, flip, overwrite, replace_word

_BOMB = 300 << 20  # bytes that a bomb unpacks to: more than a reader may take


class _Call:
    """A pickle of it calls a function when it is loaded."""

    def __init__(self, function: object, *arguments: object):
        self.called = function, arguments

    def __reduce__(self):
        return self.called


def pickles() -> tuple[bytes, ...]:
    """Return pickles that run code when they are loaded carelessly."""
    calls = (
        _Call(os.system, f"touch {CANARY}"),
        _Call(eval, f"open({CANARY!r}, 'w')"),
        _Call(exec, f"open({CANARY!r}, 'w')"),
        _Call(open, CANARY, "w"),
        _Call(os.rename, "a", CANARY),
        _Call(os.mkdir, CANARY),
        _Call(bytearray, 10**10),
        _Call(np.zeros, 10**10),
    )
    hidden = [{"format": "wernet-encoder", "version": 2, "kind": call} for call in calls]
    return tuple(pickle.dumps(item, 2) for item in (*calls, *hidden))


@functools.cache
def deflated_zeros(count: int = _BOMB) -> bytes:
    """Return ``count`` zeros, deflated without header: about a thousandth of it."""
    whole = zlib.compressobj(9, zlib.DEFLATED, -15)
    piece = bytes(1 << 20)
    block = whole.compress(piece) + whole.flush(zlib.Z_FULL_FLUSH)
    return block * (count >> 20) + zlib.compressobj(9, zlib.DEFLATED, -15).flush()


def npy(array: np.ndarray | None = None, header: str | None = None, payload: bytes = b"") -> bytes:
    """Return an ``.npy`` file: of an array, or with any header."""
    if array is not None:
        file = io.BytesIO()
        np.save(file, array, allow_pickle=array.dtype.hasobject)
        return file.getvalue()
    text = (header or "").encode("latin-1", "replace") + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", min(len(text), 65535)) + text + payload


def hostile_npys() -> tuple[bytes, ...]:
    """Return ``.npy`` files that claim what they do not hold."""
    ends = ("'fortran_order': False, 'shape': ", ", }")
    shapes = ("(10000000000,)", "(100000, 100000)", "(-1,)", "()", "(0,)", "(0, 3, 3)", "(3,)")
    shapes += ("(2, 3, 3)", "(1.5,)", "(True,)", "3", "(((3,),),)", "(9" + "9" * 200 + ",)")
    kinds = (
        "<f8",
        "<f4",
        "|O",
        "<U4000000",
        "|S1000000000",
        "<M8[s]",
        "<c16",
        "|b1",
        "<f16",
        "|V8",
    )
    kinds += (">i2", "x", "", "<f8,<f8", "<u8")
    made = [f"{{'descr': '<f8', {ends[0]}{shape}{ends[1]}" for shape in shapes]
    made += [f"{{'descr': '{kind}', {ends[0]}(2, 3, 3){ends[1]}" for kind in kinds]
    made += [f"{{'descr': [('a', '{kind}')], {ends[0]}(2,){ends[1]}" for kind in kinds[:3]]
    made += ["", "{}", "1", "[" * 500, f"__import__('os').system('touch {CANARY}')", "{'descr':"]
    objects = np.array([_Call(os.system, f"touch {CANARY}")], dtype=object)
    return (
        *(npy(header=text, payload=bytes(144)) for text in made),
        npy(objects),
        b"",
        b"\x93NUMPY",
    )


def change_zip(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Change the members of an archive and pack them again, so that check sums are right."""
    members = unpacked(data)
    if not members:
        return rng.choice(BINARY)(data, rng, corpus)
    names = list(members)
    for _ in range(rng.choice((1, 1, 2))):
        name = rng.choice(names)
        kind = rng.randrange(9)
        if kind == 0:
            members.pop(name, None)
        elif kind == 1:
            members[rng.choice(("../../x.npy", "/x.npy", "x", "data.npy", name + "x"))] = (
                members[rng.choice(list(members) or names)] if members else b""
            )
        elif kind == 2:
            members[name] = rng.choice(_NPYS)
        elif kind == 3 and name.endswith("pkl"):
            members[name] = rng.choice(_PICKLES)
        elif kind in (4, 5):
            members[name] = replace_word(members.get(name, b""), rng, corpus)
        else:
            change = rng.choice((flip, overwrite, *BINARY))
            members[name] = change(members.get(name, b"\0"), rng, corpus)
    return packed(
        members, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    )


def unpacked(data: bytes) -> dict[str, bytes]:
    """Return the members of a small archive; none where it is broken."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            if sum(item.file_size for item in file.infolist()) > 1 << 20:
                return {}
            return {item.filename: file.read(item) for item in file.infolist()}
    except Exception:  # an archive that mutations broke
        return {}


def packed(members: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """Return an archive; equal members give equal bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0))
            info.compress_type = method
            archive.writestr(info, content)
    return file.getvalue()


def zip_bomb(members: dict[str, bytes], name: str, header: bytes, count: int = _BOMB) -> bytes:
    """Return an archive one of whose members is ``header`` and then ``count`` zeros."""
    data = packed(members | {name: b""}, zipfile.ZIP_STORED)
    # zipfile writes no member that it has not packed itself: the bomb is put in by hand
    start = zlib.compressobj(9, zlib.DEFLATED, -15)
    stream = start.compress(header) + start.flush(zlib.Z_FULL_FLUSH) + deflated_zeros(count)
    check = zlib.crc32(header)
    for _ in range(count >> 20):
        check = zlib.crc32(_MEGABYTE, check)
    size = len(header) + (count >> 20 << 20)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        at = archive.getinfo(name).header_offset
        directory = archive.start_dir
    local_end = at + 30 + len(name)
    fields = struct.pack("<HHHIII", zipfile.ZIP_DEFLATED, 0, 33, check, len(stream), size)
    local = data[at : at + 8] + fields + data[at + 26 : local_end] + stream
    entry = data.rfind(b"PK\x01\x02", 0, data.rfind(name.encode()))
    central = data[directory:entry] + data[entry : entry + 10] + fields + data[entry + 28 :]
    end = central.rfind(b"PK\x05\x06")
    offset = struct.pack("<I", at + len(local))
    return data[:at] + local + central[: end + 16] + offset + central[end + 20 :]


def change_png(data: bytes, rng: Random, corpus: Sequence[bytes]) -> bytes:
    """Change a chunk of a PNG and give it the right check sum."""
    chunks = _chunks(data)
    if not chunks:
        return rng.choice(BINARY)(data, rng, corpus)
    at = rng.randrange(len(chunks))
    kind, content = chunks[at]
    choice = rng.randrange(8)
    if choice == 0:
        del chunks[at]
    elif choice == 1:
        chunks.insert(rng.randrange(len(chunks)), chunks[at])
    elif kind == b"IDAT" and choice < 5:
        try:
            rows = zlib.decompressobj().decompress(content, 1 << 20)
        except zlib.error:
            rows = bytes(100)
        chunks[at] = kind, zlib.compress(rng.choice(BINARY)(rows, rng, corpus), 1)
    else:
        chunks[at] = kind, rng.choice((flip, overwrite))(content, rng, corpus)
    return png(chunks)


def png(chunks: Sequence[tuple[bytes, bytes]]) -> bytes:
    """Return a PNG of chunks."""
    data = b"\x89PNG\r\n\x1a\n"
    for kind, content in chunks:
        check = zlib.crc32(kind + content)
        data += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)
    return data


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    chunks, at = [], 8
    while at + 12 <= len(data) and data.startswith(b"\x89PNG"):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return chunks


_MEGABYTE = bytes(1 << 20)
_PICKLES = pickles()
_NPYS = hostile_npys()
