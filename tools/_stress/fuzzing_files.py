"""Binary files of every kind that is read, as they may be and as they may not: bombs, claims."""

from __future__ import annotations

import base64
import bz2
import gzip
import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from _stress.fuzzing_containers import (
    deflated_zeros,
    hostile_npys,
    npy,
    packed,
    pickles,
    png,
    unpacked,
    zip_bomb,
)


def npz_seeds(path: Path, kind: str) -> tuple[bytes, ...]:
    """Return an archive of NumPy arrays, and what has been made of it: bombs and pickles."""
    good = path.read_bytes()
    members = unpacked(good)
    name = {"volume": "data.npy", "rays": "directions.npy", "cache": "uv.npy"}[kind]
    shape = (600, 256, 256) if kind == "volume" else (5242880, 3) if kind == "cache" else None
    big = np.lib.format.header_data_from_array_1_0(np.zeros(1))
    big["shape"] = shape or (1024, 5120, 3)
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, big)
    return (
        good,
        packed(members),
        zip_bomb(members, name, file.getvalue()),
        *(packed(members | {name: header}) for header in hostile_npys()[::3]),
    )


def vti_seeds(own: bytes) -> tuple[bytes, ...]:
    """Return VTK files of every encoding, and bombs."""
    values = np.arange(60, dtype="<f4").tobytes()
    head = (
        '<VTKFile type="ImageData" byte_order="LittleEndian"{}>\n<ImageData WholeExtent="0 2 0 3 '
        '0 4" Origin="0 0 0" Spacing="1 1 1">\n<Piece Extent="0 2 0 3 0 4"><PointData>\n'
    )
    tail = "</PointData></Piece></ImageData>{}</VTKFile>"
    coded = base64.b64encode(struct.pack("<I", 240) + values).decode()
    packed_values = zlib.compress(values)
    sizes = struct.pack("<4I", 1, 240, 240, len(packed_values))
    blocks = base64.b64encode(sizes).decode() + base64.b64encode(packed_values).decode()
    bomb = b"\x78\x9c" + deflated_zeros()
    bomb_sizes = struct.pack("<4I", 1, 300 << 20, 300 << 20, len(bomb))
    made = [own]
    for attributes, array, after in (
        ("", f'<DataArray type="Float32" format="ascii">{"1 2 3 4 5 " * 12}</DataArray>', b""),
        ("", f'<DataArray type="Float32" format="binary">{coded}</DataArray>', b""),
        (
            ' compressor="vtkZLibDataCompressor"',
            f'<DataArray type="Float32" format="binary">{blocks}</DataArray>',
            b"",
        ),
        (
            ' compressor="vtkZLibDataCompressor"',
            '<DataArray type="Float32" format="appended" offset="0"/>',
            sizes + packed_values,
        ),
        (
            ' compressor="vtkZLibDataCompressor"',
            '<DataArray type="Float32" format="appended" offset="0"/>',
            bomb_sizes + bomb,
        ),
    ):
        data = after and b'<AppendedData encoding="raw">_' + after + b"</AppendedData>"
        first, last = tail.split("{}")
        made.append((head.format(attributes) + array + first).encode() + data + last.encode())
    made.append(b"<AppendedData" * 5000)
    made.append((head.format("").replace("<VTK", "<!DOCTYPE a>\n<VTK")).encode("utf-16"))
    return tuple(made)


def nrrd_seeds(own: bytes) -> tuple[bytes, ...]:
    """Return NRRD files of every encoding, and bombs."""
    head = "NRRD0004\ntype: float\ndimension: 3\nsizes: {}\nencoding: {}\nendian: little\n"
    head += "space: 3D-right-handed\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n"
    head += "space origin: (0,0,0)\n{}\n"
    values = np.arange(24, dtype="<f4").tobytes()
    # gzip: header, stream, check sum and length of 300 MB of zeros
    check = 0
    for _ in range(300):
        check = zlib.crc32(bytes(1 << 20), check)
    bomb = b"\x1f\x8b\x08" + bytes(6) + b"\x03" + deflated_zeros()
    bomb += struct.pack("<2I", check, 300 << 20)
    squeezer = bz2.BZ2Compressor(1)
    squeezed = b"".join(squeezer.compress(bytes(1 << 20)) for _ in range(16)) + squeezer.flush()
    made = (
        ("2 3 4", "raw", "", values),
        ("2 3 4", "gzip", "", gzip.compress(values, mtime=0)),
        ("2 3 4", "bzip2", "", bz2.compress(values)),
        ("2 3 4", "ascii", "", " ".join(map(str, range(24))).encode()),
        ("2 3 4", "raw", "byte skip: -1\n", values),
        ("2 3 4", "raw", "line skip: 1000000000000\n", values),
        ("2 3 4", "gzip", "line skip: 1\n", gzip.compress(values, mtime=0)),
        ("2 3 4", "raw", "data file: ../x.raw\n", values),
        ("600 256 512", "gzip", "", bomb),
        ("2 3 4", "gzip", "", bomb),
        ("600 2560 5120", "raw", "", values),
        ("2 3 4", "bzip2", "", squeezed),
    )
    return own, *(head.format(s, e, f).encode() + d for s, e, f, d in made)


def tiff_seeds() -> tuple[bytes, ...]:
    """Return TIFF files of several kinds, and bombs."""
    import tifffile

    def tiff(image: np.ndarray, **settings) -> bytes:
        file = io.BytesIO()
        settings = {"photometric": "minisblack", "metadata": None} | settings
        tifffile.imwrite(file, image, **settings)
        return file.getvalue()

    small = np.arange(63, dtype=np.float32).reshape(7, 9)
    whole = small.astype(np.uint16)
    by_opencv = [
        cv2.imencode(".tif", image, [cv2.IMWRITE_TIFF_COMPRESSION, code])[1].tobytes()
        for image in (whole, whole.astype(np.uint8))
        for code in (5, 32773)  # LZW and PackBits
    ]
    flat = tiff(small, compression="zlib")
    zeros = b"\x78\x9c" + deflated_zeros()
    return (
        tiff(small),
        flat,
        tiff(whole, bigtiff=True),
        tiff(whole, byteorder=">", software="x"),
        tiff(whole, compression="zlib", predictor=2),
        tiff(whole, tile=(16, 16)),
        tiff(np.stack([whole, whole])),
        tiff(small, compression="lzma"),
        *by_opencv,
        _tiff_of(9000, 8192, 32, 8, zeros),
        _tiff_of(9, 7, 32, 8, zeros),
        _tiff_of(2**20, 2**14, 8, 8, zeros[:1000]),
        _tiff_of(30000, 30000, 16, 5, zeros[:1000]),
        _tiff_of(30000, 30000, 8, 1, zeros[:1000]),
    )


def _tiff_of(width: int, height: int, bits: int, compression: int, strip: bytes) -> bytes:
    """Return a TIFF of one strip, whatever is in it."""
    kind = 3 if bits == 32 else 1
    tags = {256: width, 257: height, 258: bits, 259: compression, 262: 1, 273: 200, 277: 1}
    tags |= {278: height, 279: len(strip), 339: kind}
    entries = b"".join(struct.pack("<2H2I", tag, 4, 1, value) for tag, value in tags.items())
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(4)
    return head.ljust(200, b"\0") + strip


def png_seeds() -> tuple[bytes, ...]:
    """Return PNG and JPEG files, and bombs."""
    grey = (np.arange(63).reshape(7, 9) * 4).astype(np.uint8)
    made = [
        cv2.imencode(".png", image)[1].tobytes()
        for image in (grey, grey.astype(np.uint16) * 200, np.dstack([grey] * 3))
    ]
    header = struct.pack(">2I5B", 20000, 20000, 8, 0, 0, 0, 0)
    rows = b"\x78\x9c" + deflated_zeros()
    bomb = png([(b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")])
    empty = png([(b"IHDR", struct.pack(">2I5B", 2**16, 2**14, 16, 6, 0, 0, 0)), (b"IEND", b"")])
    jpeg = cv2.imencode(".jpg", grey)[1].tobytes()
    frame = jpeg.index(b"\xff\xc0")
    huge = jpeg[: frame + 5] + struct.pack(">2H", 32000, 32000) + jpeg[frame + 9 :]
    return (*made, jpeg, bomb, empty, huge)


def other_images() -> tuple[bytes, ...]:
    """Return images of the other kinds that calibration reads."""
    grey = (np.arange(63).reshape(7, 9) * 4).astype(np.uint8)
    made = [cv2.imencode(e, grey)[1].tobytes() for e in (".bmp", ".pgm", ".webp", ".tif")]
    bmp = made[0]
    huge = bmp[:18] + struct.pack("<2i", 20000, 20000) + bmp[26:]
    return (*made, b"P2\n3 2\n9\n1 2 3 4 5 6\n", huge, b"P5\n30000 30000\n255\n" + bytes(9))


def torch_seeds(files: list[bytes]) -> tuple[bytes, ...]:
    """Return files of tensors, what has been made of them, and pickles that run code."""
    made = list(files)
    for good in files:
        members = unpacked(good)
        name = next((n for n in members if n.endswith("data.pkl")), None)
        if name is not None:
            made += [packed(members | {name: hostile}) for hostile in pickles()[::2]]
    return (*made, *pickles(), npy(np.zeros(3)))


def tensor_tricks(content: dict) -> list[dict]:
    """Return contents of an encoder's file that claim more than the file holds."""
    import torch

    wide = torch.zeros(1).expand(2**31)
    changes = (
        *({"channels": 20000}, {"blocks": 10**9}, {"blocks": 2.0}, {"channels": "8"}),
        *({"seed": 2**70}, {"blocks": True}, {"x": 1}),
    )
    made = [content | {"settings": content["settings"] | change} for change in changes]
    state = content["state"]
    for name in list(state)[:2]:
        for tensor in (wide, wide.view(2**11, 2**20), torch.zeros(3).to(torch.complex64)):
            made.append(content | {"state": state | {name: tensor}})
        made.append(content | {"state": state | {name: torch.full_like(state[name], torch.nan)}})
        made.append(content | {"state": state | {name: state[name].to_sparse()}})
        made.append(content | {"state": state | {name: [1, 2]}})
    return [
        *made,
        content | {"state": [1]},
        content | {"kind": ["weights"]},
        content | {"kind": 0},
    ]
