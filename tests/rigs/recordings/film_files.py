"""Films of every format, written by other libraries or from published layouts alone."""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import tifffile
from PIL import Image

NUMBERS = np.random.default_rng(0).integers(0, 4096, (6, 40, 48)).astype(np.uint16)
FRAMES = NUMBERS * np.uint16(16)


def packed(image, bits):
    """Return pixels of ``bits`` each without gaps, the high bit first."""
    places = np.arange(bits - 1, -1, -1)
    ones = (image.reshape(-1)[:, None].astype(np.int64) >> places & 1).astype(np.uint8)
    return np.packbits(ones).tobytes()


def folder_of_tiffs(tmp_path):
    (tmp_path / "cam").mkdir()
    for number, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / "cam" / f"{number + 8}.tif"), frame)  # 8, 9, 10: natural order
    return tmp_path / "cam", FRAMES


def tiff_stack(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    return tmp_path / "a.tif", FRAMES


def big_tiff_in_tiles(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", FRAMES, bigtiff=True, tile=(16, 16), compression="zlib",
        byteorder=">", photometric="minisblack",
    )  # fmt: skip
    return tmp_path / "a.tif", FRAMES


def ome_tiff(tmp_path):
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, photometric="minisblack", ome=True)
    return tmp_path / "a.ome.tif", FRAMES


def pillow_s_tiff(tmp_path):
    first, *others = [Image.fromarray(frame) for frame in FRAMES]
    first.save(tmp_path / "a.tif", save_all=True, append_images=others, compression="tiff_lzw")
    return tmp_path / "a.tif", FRAMES


def lossless_video(tmp_path):
    frames = (FRAMES >> 8).astype(np.uint8)
    writer = cv2.VideoWriter(
        str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25, (48, 40), isColor=False
    )
    for frame in frames:
        writer.write(frame)
    writer.release()
    return tmp_path / "a.avi", frames


def video_of_16_bits(tmp_path):
    import av

    with av.open(str(tmp_path / "a.mkv"), "w") as file:
        stream = file.add_stream("ffv1", rate=500, width=48, height=40, pix_fmt="gray16le")
        for frame in FRAMES:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "gray16le")))
        file.mux(stream.encode())
    return tmp_path / "a.mkv", FRAMES


def nexus(tmp_path, **options):
    import h5py

    with h5py.File(tmp_path / "a.nxs", "w") as file:
        data = file.create_group("entry/data")
        data.attrs.update({"NX_class": "NXdata", "signal": "data", "axes": ["time", ".", "."]})
        data.create_dataset("data", data=FRAMES.astype(">u2"), **options)
        data["time"] = np.arange(6) * 200.0
        data["time"].attrs["units"] = "us"
    return Path(f"{tmp_path / 'a.nxs'}:/entry/data/data"), FRAMES


def nexus_in_chunks(tmp_path):
    return nexus(tmp_path, chunks=(2, 16, 16), compression="gzip", shuffle=True)


def zarr_array(tmp_path):
    import zarr

    array = zarr.create_array(tmp_path / "a.zarr", data=FRAMES, chunks=(1, 16, 48))
    return Path(array.store.root), FRAMES


def xarray_s_zarr(tmp_path):
    import xarray

    image = xarray.DataArray(
        FRAMES,
        dims=("time", "y", "x"),
        coords={"time": np.arange(6) * 0.2},
        name="image",
    )
    image.time.attrs["units"] = "ms"
    image.to_dataset().to_zarr(tmp_path / "a.zarr", zarr_format=2, consolidated=False)
    return Path(f"{tmp_path / 'a.zarr'}:/image"), FRAMES


def numpy_array(tmp_path):
    np.save(tmp_path / "a.npy", FRAMES.astype(">u2"))
    return tmp_path / "a.npy", FRAMES


def numpy_array_of_columns(tmp_path):
    np.save(tmp_path / "a.npy", np.asfortranarray(FRAMES / np.float32(65535)))
    return tmp_path / "a.npy", FRAMES / np.float32(65535)


def pymraw_s_film(tmp_path):
    import pyMRAW

    changes = {"Record Rate(fps)": "60000", "Start Frame": "300", "Save Step": "3"}
    path, _ = pyMRAW.save_mraw(NUMBERS, str(tmp_path / "a.cih"), 16, info_dict=changes)
    return Path(path), NUMBERS


def photron(tmp_path, bits, side="Lower", suffix=".cihx"):
    """Write a Photron film from its layout: a description beside the pixels."""
    depth = min(bits, 12)
    frames = (NUMBERS >> (12 - depth)).astype(np.uint8 if bits == 8 else np.uint16)
    stored = frames << (bits - depth if side == "Higher" else 0)
    content = stored.astype(f"<u{bits // 8}").tobytes() if bits in (8, 16) else b""
    content = content or b"".join(packed(frame, bits) for frame in frames)
    (tmp_path / "a.mraw").write_bytes(content)
    if suffix == ".cihx":
        text = (
            "\0\0CIHX\n<cih><fileInfo><date>2026/1/2</date></fileInfo>"
            "<frameInfo><totalFrame>6</totalFrame><recordedFrame>60</recordedFrame>"
            "<startFrame>-10</startFrame></frameInfo><recordInfo><recordRate>2000</recordRate>"
            "<shutterSpeed>0.0001</shutterSpeed></recordInfo><basicInfo><comment>b\u00fc</comment>"
            "</basicInfo><deviceInfo><deviceName>FASTCAM</deviceName></deviceInfo><imageDataInfo><resolution><width>48</width><height>40</height>"
            f"</resolution><colorInfo><type>Mono</type><bit>{bits}</bit></colorInfo>"
            f"<effectiveBit><depth>{depth}</depth><side>{side}</side></effectiveBit>"
            "</imageDataInfo><imageFileInfo><fileFormat>MRaw</fileFormat></imageFileInfo></cih>\n"
        )
    else:
        text = (
            "#Camera Information Header\r\nCamera Type : FASTCAM\r\nRecord Rate(fps) : 2000\r\n"
            "Total Frame : 6\r\nStart Frame : -10\r\nImage Width : 48\r\nImage Height : 40\r\n"
            f"Color Type : Mono\r\nColor Bit : {bits}\r\nFile Format : MRaw\r\n"
            f"EffectiveBit Depth : {depth}\r\nEffectiveBit Side : {side}\r\n"
            "Comment Text : \r\n\r\n#System Information:\r\nTotal Frame : 99\r\nEND\r\n"
        )
    (tmp_path / f"a{suffix}").write_text(text, newline="")
    return tmp_path / "a.mraw", frames


def cine(tmp_path, bits, packing=0, rate=1000.0, old=False, note=b"note"):
    """Write a Phantom film from its layout; frames are packed or bottom-up rows of 8, 16 bits."""
    depth = {0: min(bits, 12), 256: 10, 1024: 12}[packing]
    frames = (NUMBERS >> (12 - depth)).astype(np.uint8 if bits == 8 else np.uint16)
    bodies = []
    for frame in frames:
        body = packed(frame, depth) if packing else frame[::-1].astype(f"<u{bits // 8}").tobytes()
        bodies.append(
            struct.pack("<I", 8 + len(note)) + note + struct.pack("<I", len(body)) + body
        )
    setup = bytearray(700 if old else 10684)
    setup[140:144] = struct.pack("<2sH", b"ST", len(setup))
    if not old:
        struct.pack_into("<I", setup, 768, int(rate))
        struct.pack_into("<I", setup, 896, depth)
        struct.pack_into("<2I", setup, 1580, 128, 64)
        struct.pack_into("<2i", setup, 5732, 64, 4064)
        struct.pack_into("<d", setup, 10400, rate)
    times = [(1_700_000_000 << 32) + round((0.25 + n / rate) * 2**32) for n in range(6)]
    tags = struct.pack("<IHH", 8 + 8 * 6, 1002, 1) + struct.pack("<6Q", *times)
    tags = struct.pack("<IHH4s", 12, 1007, 1, b"more") + tags
    start = 44 + 40 + len(setup) + len(tags)
    wide = 4 if old else 8
    places, at = [], start + 6 * wide
    for body in bodies:
        places.append(at)
        at += len(body)
    head = struct.pack("<2s3HiIiI3I2I", b"CI", 44, 0, int(not old), -5, 100, -5, 6,
                       44, 84, start, 1 << 31, 1_700_000_000)  # fmt: skip
    bitmap = struct.pack("<IiiHHIIiiII", 40, 48, 40, 1, bits, packing, len(body), 0, 0, 0, 0)
    table = struct.pack(f"<6{'I' if old else 'Q'}", *places)
    path = tmp_path / "a.cine"
    path.write_bytes(head + bitmap + bytes(setup) + tags + table + b"".join(bodies))
    return path, frames


def readim7_s_images(tmp_path, is_packed):
    """Write a folder of files of two frames each."""
    from readim7 import core

    (tmp_path / "cam").mkdir()
    scale = {"factor": 1.0, "offset": 0.0, "description": "", "unit": ""}
    head = {"nx": 48, "ny": 40, "nz": 1, "nf": 2, "vector_grid": 1, "image_sub_type": -4}
    head |= {"is_float": False, "mask": None, "scaleX": scale, "scaleY": scale, "scaleI": scale}
    for number in range(3):
        path = tmp_path / "cam" / f"B{number + 9:05d}.im7"
        info = head | {"array": FRAMES[2 * number : 2 * number + 2]}
        times = {f"AcqTimeSeries{one}": b"%d \xb5s" % (200 * number) for one in range(2)}
        core.write_file(str(path), is_packed, info, {k.encode(): v for k, v in times.items()})
    return tmp_path / "cam", FRAMES


def im7(tmp_path, packing):
    """Write an .im7 file from its layout, compressed by zlib or packed in 12 bits."""
    frames = FRAMES if packing == 2 else NUMBERS
    if packing == 2:
        data = zlib.compress(frames.astype("<u2").tobytes())
        data = struct.pack("<I", len(data)) + data
    else:
        groups = frames.reshape(-1, 4).astype(np.uint64)
        joined = sum(groups[:, n] << np.uint64(12 * n) for n in range(4))
        data = joined.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :6].tobytes()
    head = struct.pack("<4h4i3h", 0, packing, -4, 0, 48, 40, 1, 6, 0, 1, 0)
    (tmp_path / "a.im7").write_bytes(head.ljust(256, b"\0") + data)
    return tmp_path / "a.im7", frames


@dataclass(frozen=True)
class Film:
    """A film of six frames: how it is made, by whose program, and the bits of its pixels."""

    make: Callable
    writer: str
    bits: int | None = 16


LAYOUT = "own bytes from the layout"
FILMS = {
    "folder of TIFFs": Film(folder_of_tiffs, "OpenCV"),
    "TIFF": Film(tiff_stack, "tifffile"),
    "BigTIFF in tiles": Film(big_tiff_in_tiles, "tifffile"),
    "OME-TIFF": Film(ome_tiff, "tifffile"),
    "Pillow's TIFF": Film(pillow_s_tiff, "Pillow"),
    "video": Film(lossless_video, "OpenCV", 8),
    "video of 16 bits": Film(video_of_16_bits, "PyAV"),
    "cine 8": Film(partial(cine, bits=8), LAYOUT, 8),
    "cine 16": Film(partial(cine, bits=16), LAYOUT, 12),
    "cine packed": Film(partial(cine, bits=16, packing=1024), LAYOUT, 12),
    "old cine": Film(partial(cine, bits=16, old=True), LAYOUT),
    "pyMRAW's film": Film(pymraw_s_film, "pyMRAW", 12),
    "Photron 8": Film(partial(photron, bits=8), LAYOUT, 8),
    "Photron 10": Film(partial(photron, bits=10), LAYOUT, 10),
    "Photron 12": Film(partial(photron, bits=12), LAYOUT, 12),
    "Photron 16": Film(partial(photron, bits=16), LAYOUT, 12),
    "Photron high": Film(partial(photron, bits=16, side="Higher", suffix=".cih"), LAYOUT, 12),
    "im7 plain": Film(partial(readim7_s_images, is_packed=False), "readim7"),
    "im7 differences": Film(partial(readim7_s_images, is_packed=True), "readim7"),
    "im7 zlib": Film(partial(im7, packing=2), LAYOUT),
    "im7 12 bits": Film(partial(im7, packing=3), LAYOUT),
    "NeXus": Film(nexus, "h5py"),
    "NeXus in chunks": Film(nexus_in_chunks, "h5py"),
    "Zarr": Film(zarr_array, "zarr"),
    "Zarr of xarray": Film(xarray_s_zarr, "xarray"),
    "NumPy": Film(numpy_array, "NumPy"),
    "NumPy by columns": Film(numpy_array_of_columns, "NumPy", None),
}
"""Films that say themselves what they are."""
