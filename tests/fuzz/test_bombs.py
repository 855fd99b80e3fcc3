"""Small files that unpack to 300 MB, claim huge sizes, or hold code: refused, in little memory."""

import bz2
import functools
import io
import os
import pickle
import struct
import zipfile
import zlib

import cv2
import numpy as np
import pytest
import torch
from mutations import packed, png, unpacked
from samples import readers

BOMB = 300 << 20
MEGABYTE = bytes(1 << 20)


@functools.cache
def deflated_zeros():
    """Return 300 MB of zeros, deflated without header: about a thousandth of it."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(MEGABYTE) + packer.flush(zlib.Z_FULL_FLUSH)
    return block * (BOMB >> 20) + zlib.compressobj(9, zlib.DEFLATED, -15).flush()


@functools.cache
def check_sum(header):
    check = zlib.crc32(header)
    for _ in range(BOMB >> 20):
        check = zlib.crc32(MEGABYTE, check)
    return check


def zip_bomb(members, name, header):
    """Return an archive one of whose members is ``header`` and then 300 MB of zeros.

    zipfile writes no member that it has not packed itself: this one is put in by hand, as the
    first, and the directory and what it says of places follow.
    """
    start = zlib.compressobj(9, zlib.DEFLATED, -15)
    stream = start.compress(header) + start.flush(zlib.Z_FULL_FLUSH) + deflated_zeros()
    size = len(header) + BOMB
    fields = struct.pack("<HHHIII", 8, 0, 33, check_sum(header), len(stream), size)
    fields += struct.pack("<HH", len(name), 0)
    local = b"PK\x03\x04\x14\0\0\0" + fields + name.encode() + stream
    rest = packed({other: data for other, data in members.items() if other != name})
    directory = rest.index(b"PK\x01\x02")
    end = rest.rindex(b"PK\x05\x06")
    central = b"PK\x01\x02\x14\0\x14\0\0\0" + fields + bytes(14) + name.encode()
    entries = bytearray(rest[directory:end])
    at = 0
    while at < len(entries):  # the other members stand behind the bomb
        (offset,) = struct.unpack_from("<I", entries, at + 42)
        struct.pack_into("<I", entries, at + 42, offset + len(local))
        at += 46 + sum(struct.unpack_from("<3H", entries, at + 28))
    central += bytes(entries)
    count = len(members | {name: b""})
    tail = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, count, count, len(central),
                       len(local) + directory, 0)  # fmt: skip
    return local + rest[:directory] + central + tail


def npy_header(shape, dtype="<f8"):
    file = io.BytesIO()
    said = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, said)
    return file.getvalue()


def tiff_of(width, height, bits, compression, strip):
    kind = 3 if bits == 32 else 1
    tags = {256: width, 257: height, 258: bits, 259: compression, 262: 1, 273: 200, 277: 1}
    tags |= {278: height, 279: len(strip), 339: kind}
    entries = b"".join(struct.pack("<2H2I", tag, 4, 1, value) for tag, value in tags.items())
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(4)
    return head.ljust(200, b"\0") + strip


def nrrd(sizes, encoding, data):
    head = f"NRRD0004\ntype: float\ndimension: 3\nsizes: {sizes}\nencoding: {encoding}\n"
    return (head + "endian: little\nspace: 3D-right-handed\n\n").encode() + data


def vti(data):
    head = (
        '<VTKFile type="ImageData" byte_order="LittleEndian" compressor="vtkZLibDataCompressor">'
        '<ImageData WholeExtent="0 2 0 3 0 4" Origin="0 0 0" Spacing="1 1 1">'
        '<Piece Extent="0 2 0 3 0 4"><PointData><DataArray type="Float32" format="appended" '
        'offset="0"/></PointData></Piece></ImageData>'
    )
    sizes = struct.pack("<4I", 1, BOMB, BOMB, len(data))
    return head.encode() + b'<AppendedData encoding="raw">_' + sizes + data + b"</AppendedData>"


def png_of(width, height, rows):
    header = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    return png([(b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")])


def jpeg_of(width, height):
    jpeg = cv2.imencode(".jpg", np.zeros((7, 9), np.uint8))[1].tobytes()
    frame = jpeg.index(b"\xff\xc0")
    return jpeg[: frame + 5] + struct.pack(">2H", height, width) + jpeg[frame + 9 :]


def bomb_in(member, shape):
    return lambda sample: zip_bomb(unpacked(sample), member, npy_header(shape))


def by_zlib():
    return b"\x78\x9c" + deflated_zeros()


def by_gzip():
    end = struct.pack("<2I", check_sum(b""), BOMB)
    return b"\x1f\x8b\x08" + bytes(6) + b"\x03" + deflated_zeros() + end


def by_bzip2():
    packer = bz2.BZ2Compressor(1)
    return b"".join(packer.compress(MEGABYTE) for _ in range(32)) + packer.flush()


BOMBS = {
    "volume .npz": ("volume .npz", bomb_in("data.npy", (600, 256, 256))),
    "ray table": ("ray table", bomb_in("directions.npy", (1024, 5120, 3))),
    "detection cache": ("detection cache", bomb_in("uv.npy", (5242880, 3))),
    "volume .vti": ("volume .vti", lambda _: vti(by_zlib())),
    "volume .vti, utf-16": (
        "volume .vti",
        lambda _: (
            vti(b"").decode("latin-1").replace("<VTK", "<!DOCTYPE a>\n<VTK").encode("utf-16")
        ),
    ),
    "volume .vti, nested": ("volume .vti", lambda _: b"<AppendedData" * 5000),
    "volume .nrrd, gzip": ("volume .nrrd", lambda _: nrrd("2 3 4", "gzip", by_gzip())),
    "volume .nrrd, its size": ("volume .nrrd", lambda _: nrrd("600 256 512", "gzip", by_gzip())),
    "volume .nrrd, bzip2": ("volume .nrrd", lambda _: nrrd("2 3 4", "bzip2", by_bzip2())),
    "volume .nrrd, no values": (
        "volume .nrrd",
        lambda _: nrrd("600 2560 5120", "raw", bytes(96)),
    ),
    "image .tif": ("image .tif", lambda _: tiff_of(9, 7, 32, 8, by_zlib())),
    "image .tif, its size": ("image .tif", lambda _: tiff_of(9000, 8192, 32, 8, by_zlib())),
    "image .tif, huge": ("image .tif", lambda _: tiff_of(2**20, 2**14, 8, 8, by_zlib()[:1000])),
    "image .tif, LZW": ("image .tif", lambda _: tiff_of(30000, 30000, 16, 5, by_zlib()[:1000])),
    "image .tif, plain": ("image .tif", lambda _: tiff_of(30000, 30000, 8, 1, by_zlib()[:1000])),
    "image .png": ("image .png", lambda _: png_of(20000, 20000, by_zlib())),
    "image .png, huge": ("image .png", lambda _: png_of(2**16, 2**14, b"")),
    "image .jpg": ("image .jpg", lambda _: jpeg_of(32000, 32000)),
    "calibration image, BMP": (
        "calibration image",
        lambda _: b"BM" + bytes(12) + struct.pack("<I2i2H", 40, 20000, 20000, 1, 8) + bytes(90),
    ),
    "calibration image, PGM": (
        "calibration image",
        lambda _: b"P5\n30000 30000\n255\n" + bytes(9),
    ),
    "calibration image, JPEG": ("calibration image", lambda _: jpeg_of(32000, 32000)),
}


@pytest.fixture(scope="module")
def every_reader(tmp_path_factory):
    return readers(tmp_path_factory.mktemp("samples"))


@pytest.mark.parametrize("bomb", BOMBS)
def test_bombs_are_refused_in_little_memory(every_reader, read_or_refused, tmp_path, bomb):
    name, make = BOMBS[bomb]
    reader = every_reader[name]
    path = tmp_path / reader.file
    path.write_bytes(reader.samples[0])
    reader.read(path)  # what reading imports takes memory too
    path.write_bytes(make(reader.samples[0]))
    assert read_or_refused(reader.read, path, tmp_path)


class Call:
    """A pickle of it calls a function when it is loaded."""

    def __init__(self, function, *arguments):
        self.called = function, arguments

    def __reduce__(self):
        return self.called


CALLS = (Call(os.mkdir, "executed"), Call(exec, "open('executed', 'w')"))
MEMORY_CALL = Call(bytearray, BOMB)  # PyTorch's reader of tensors lets it be made


@pytest.mark.parametrize(
    ("name", "call"),
    [
        *((name, call) for name in ("encoder", "checkpoint") for call in CALLS),
        *((name, call) for name in ("volume .npz", "ray table") for call in (*CALLS, MEMORY_CALL)),
    ],
)
def test_code_in_a_file_is_not_run(
    every_reader, read_or_refused, tmp_path, monkeypatch, name, call
):
    monkeypatch.chdir(tmp_path)
    reader = every_reader[name]
    members = unpacked(reader.samples[0])
    hidden = pickle.dumps({"format": "wernet-encoder", "version": 4, "state": call}, 2)
    objects = io.BytesIO()
    np.save(objects, np.array([call], dtype=object), allow_pickle=True)
    contents = [pickle.dumps(call, 2), hidden]
    for member in members:
        swapped = hidden if member.endswith("pkl") else objects.getvalue()
        contents.append(packed(members | {member: swapped}))
    for content in contents:
        path = tmp_path / reader.file
        path.write_bytes(content)
        read_or_refused(reader.read, path, tmp_path)
        assert not (tmp_path / "executed").exists()


def encoder_tricks(content):
    """Return contents of an encoder's file that claim more than the file holds."""
    wide = torch.zeros(1).expand(2**31)
    for change in ({"channels": 20000}, {"blocks": 10**9}, {"blocks": 2.0}, {"channels": "8"},
                   {"seed": 2**70}, {"blocks": True}, {"x": 1}):  # fmt: skip
        yield content | {"settings": content["settings"] | change}
    state = content["state"]
    for name in list(state)[:2]:
        complex_numbers, nothing = torch.zeros(3).to(torch.complex64), state[name] * torch.nan
        for value in (wide, wide.view(2**11, 2**20), complex_numbers, [1, 2], nothing,
                      state[name].to_sparse()):  # fmt: skip
            yield content | {"state": state | {name: value}}
    yield from (content | {"state": [1]}, content | {"kind": ["weights"]}, content | {"kind": 0})


def test_encoders_that_claim_more_than_they_hold(every_reader, read_or_refused, tmp_path):
    reader = every_reader["encoder"]
    path = tmp_path / reader.file
    path.write_bytes(reader.samples[0])
    for trick in encoder_tricks(torch.load(path, weights_only=True)):
        torch.save(trick, path)
        read_or_refused(reader.read, path, tmp_path)


def test_a_bomb_is_an_archive_that_unpacks_to_much():
    bomb = zip_bomb({"a.npy": b"x", "b.npy": b"y"}, "b.npy", b"head")
    assert len(bomb) < BOMB / 500
    with zipfile.ZipFile(io.BytesIO(bomb)) as archive:
        assert sorted(archive.namelist()) == ["a.npy", "b.npy"]
        assert archive.read("a.npy") == b"x"
        assert archive.getinfo("b.npy").file_size == 4 + BOMB
        with archive.open("b.npy") as member:
            assert member.read(8) == b"head" + bytes(4)
