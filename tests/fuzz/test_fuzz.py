"""Damaged files: every reader reads them or refuses them in one line, and does nothing else.

15 files a reader by default, 3,000 with ``--hypothesis-profile=long``, see tests/conftest.py.
"""

import contextlib
import io
import logging
import os
import pickle
import struct
import warnings
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from damage import damaged, packed, png, unpacked
from hypothesis import given, note, settings
from promptness import takes_less_than
from samples import GROUPS

from rigs.formats import _lens

MOST_SECONDS = 3.0  # of processor time for one small file; what backtracks takes minutes
MOST_MEMORY = 250 << 20  # bytes for one small file: bombs unpack to 300 MB
BOMB = 300 << 20
STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak_memory():
    """Return the largest memory of this process since it was forgotten, in bytes."""
    if not FORGET.exists():
        return 0
    return int(STATUS.read_text().partition("VmHWM:")[2].split(maxsplit=1)[0]) << 10


def read_or_refused(read, path, folder):
    """Read a file, or be refused by one line that names a file; quickly, without writing any.

    Returns the line of the refusal, or None.
    """
    before = sorted(folder.rglob("*"))
    if FORGET.exists():
        FORGET.write_text("5")
    floor, refusal = peak_memory(), None
    with takes_less_than(MOST_SECONDS):
        try:
            read(path)
        except (ValueError, OSError) as error:
            refusal = str(error)
    assert peak_memory() - floor < MOST_MEMORY
    assert sorted(folder.rglob("*")) == before
    if refusal is not None:
        assert len(refusal.splitlines()) == 1, refusal
        assert any(one.name in refusal for one in (folder, *before))
    return refusal


@pytest.fixture(scope="module", autouse=True)
def quiet():
    """Tables of rays take memory by the camera's pixels, and libraries log what they dislike."""
    logging.disable()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_lens, "MOST_RAYS", 1 << 14)
        yield
    logging.disable(logging.NOTSET)


def try_damaged(name, reader, folder):
    """Read many damaged files by one reader."""
    path = folder / reader.file
    for other, content in {**reader.others, reader.file: b""}.items():
        (folder / other).parent.mkdir(parents=True, exist_ok=True)
        (folder / other).write_bytes(content)
    for sample in reader.samples:  # what reading imports takes memory too
        path.write_bytes(sample)
        with contextlib.suppress(ValueError, OSError), warnings.catch_warnings(action="ignore"):
            reader.read(path)

    @settings(max_examples=settings().max_examples * 3 // 5)
    @given(damaged(reader.samples, reader.changes))
    def check(content):
        note(name)
        path.write_bytes(content)
        with warnings.catch_warnings(action="ignore"):
            read_or_refused(reader.read, path, folder)

    check()


@pytest.mark.parametrize("group", GROUPS)
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path_factory, monkeypatch, group):
    for name, reader in GROUPS[group](tmp_path_factory.mktemp("samples")).items():
        folder = tmp_path_factory.mktemp("files")
        monkeypatch.chdir(folder)  # where code in a file would write
        try_damaged(name, reader, folder)


def npy_header(shape):
    file = io.BytesIO()
    said = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, said)
    return file.getvalue()


def bomb_in(member, shape):
    """Return a function from an archive to it with a member of 300 MB of zeros."""

    def make(sample):
        file = io.BytesIO(packed({n: data for n, data in unpacked(sample).items() if n != member}))
        with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr(member, npy_header(shape) + bytes(BOMB))
        return file.getvalue()

    return make


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


def png_of(width, height, rows):
    header = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    return png([(b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")])


def jpeg_of(width, height):
    jpeg = cv2.imencode(".jpg", np.zeros((7, 9), np.uint8))[1].tobytes()
    frame = jpeg.index(b"\xff\xc0")
    return jpeg[: frame + 5] + struct.pack(">2H", height, width) + jpeg[frame + 9 :]


BOMBS = {
    ("volumes", "volume .npz"): [bomb_in("data.npy", (600, 256, 256))],
    ("scans", "ray table"): [bomb_in("directions.npy", (1024, 5120, 3))],
    ("volumes", "volume .nrrd"): [
        lambda _: nrrd("600 256 512", "gzip", zlib.compress(bytes(BOMB), 1, wbits=31)),
        lambda _: nrrd("600 2560 5120", "raw", bytes(96)),
    ],
    ("images", "image .tif"): [
        lambda _: tiff_of(9000, 8192, 32, 8, zlib.compress(bytes(BOMB), 1)),
        lambda _: tiff_of(30000, 30000, 16, 5, bytes(1000)),
        lambda _: tiff_of(30000, 30000, 8, 1, bytes(1000)),
    ],
    ("images", "image .png"): [lambda _: png_of(20000, 20000, zlib.compress(bytes(BOMB), 1))],
    ("images", "image .jpg"): [lambda _: jpeg_of(32000, 32000)],
    ("images", "calibration image"): [
        lambda _: b"BM" + bytes(12) + struct.pack("<I2i2H", 40, 20000, 20000, 1, 8) + bytes(90),
        lambda _: b"P5\n30000 30000\n255\n" + bytes(9),
    ],
}


@pytest.mark.parametrize(("group", "name"), BOMBS)
def test_files_that_claim_or_unpack_to_much_are_refused_in_little_memory(tmp_path, group, name):
    (tmp_path / "samples").mkdir()
    reader = GROUPS[group](tmp_path / "samples")[name]
    path = tmp_path / reader.file
    path.write_bytes(reader.samples[0])
    reader.read(path)  # what reading imports takes memory too
    for make in BOMBS[group, name]:
        path.write_bytes(make(reader.samples[0]))
        assert read_or_refused(reader.read, path, tmp_path)


class Call:
    """A pickle of it calls a function when it is loaded."""

    def __init__(self, function, *arguments):
        self.called = function, arguments

    def __reduce__(self):
        return self.called


@pytest.mark.parametrize(
    ("group", "name"),
    [("learned", "encoder"), ("learned", "checkpoint"), ("volumes", "volume .npz"),
     ("scans", "ray table")],
)  # fmt: skip
def test_code_in_a_file_is_not_run(tmp_path, monkeypatch, group, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "samples").mkdir()
    reader = GROUPS[group](tmp_path / "samples")[name]
    path = tmp_path / reader.file
    for call in (Call(os.mkdir, "executed"), Call(exec, "open('executed', 'w')")):
        hidden = pickle.dumps({"format": "wernet-encoder", "version": 4, "state": call}, 2)
        objects, members = io.BytesIO(), unpacked(reader.samples[0])
        np.save(objects, np.array([call], dtype=object), allow_pickle=True)
        contents = [pickle.dumps(call, 2), hidden]
        for member in members:
            swapped = hidden if member.endswith("pkl") else objects.getvalue()
            contents.append(packed(members | {member: swapped}))
        for content in contents:
            path.write_bytes(content)
            read_or_refused(reader.read, path, tmp_path)
            assert not (tmp_path / "executed").exists()


def test_encoders_that_claim_more_than_they_hold(tmp_path):
    (tmp_path / "samples").mkdir()
    reader = GROUPS["learned"](tmp_path / "samples")["encoder"]
    path = tmp_path / reader.file
    path.write_bytes(reader.samples[0])
    content = torch.load(path, weights_only=True)
    first, wide = next(iter(content["state"])), torch.zeros(1).expand(2**31)
    tricks = [content | {"settings": content["settings"] | change}
              for change in ({"channels": 20000}, {"blocks": 10**9}, {"blocks": 2.0},
                             {"channels": "8"}, {"seed": 2**70}, {"x": 1})]  # fmt: skip
    tricks += [content | {"state": content["state"] | {first: value}}
               for value in (wide, wide.view(2**11, 2**20), torch.zeros(3).to(torch.complex64),
                             [1, 2], content["state"][first].to_sparse())]  # fmt: skip
    for trick in [*tricks, content | {"state": [1]}, content | {"kind": ["weights"]}]:
        torch.save(trick, path)
        read_or_refused(reader.read, path, tmp_path)
