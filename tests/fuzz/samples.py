"""Every reader of files, with small valid files: of rigs from `samples.yaml`, others written."""

import functools
import gzip
import io
import os
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import film_files
import numpy as np
import tifffile
import torch
import yaml
from damage import ARCHIVE, BINARY, PNG, TEXT, TREE

from rigs import Camera, RayTable, Rig, formats, look_at
from rigs.calibrate.detect._detection_run import read_cache, write_cache
from rigs.calibrate.detect.found import Found
from rigs.calibrate.detect.image_sets import read_source
from rigs.files import load_rig, save_rig
from rigs.files.world_file import load_world
from rigs.ray_table.ray_file import load_ray_table, save_ray_table
from rigs.recordings import (
    image_notes,
    is_integer_image,
    open_recording,
    read_image,
    read_still,
    split_member,
)
from tomo import VoxelGrid, load_scan
from tomo.io import read_volume, write_volume
from tomo.wernet import Encoder, load_encoder, save_encoder
from tomo.wernet.files import load_training, save_training

TESTS = Path(__file__).parents[1]

TREES = (".json", ".yaml", ".yml", ".sfm")
SIZE = (9, 7)
ASKED = ("middlebury", "opencv", "bundler", "projection", "dlt", "easymocap", "camera_table",
         "realitycapture")  # fmt: skip
"""Formats whose samples hold no image size."""


@dataclass(frozen=True)
class Reader:
    """One reader: the file that is damaged, how it is read and changed, and what lies with it."""

    file: str
    read: Callable
    samples: tuple[bytes, ...]
    changes: tuple
    others: Mapping[str, bytes] = field(default_factory=dict)


def _rigs(folder):
    """A reader for each file of each set of samples, and some that do not know the format."""
    sets = yaml.safe_load((TESTS / "rigs/formats/samples.yaml").read_text("utf-8"))
    found, every = {}, []
    for name, files in [(name, files) for name, several in sets.items() for files in several]:
        content = {file: text.encode() for file, text in files.items()}
        first, size = next(iter(files)), SIZE if name in ASKED or "calib.txt" in files else None

        def load(path, name=name, first=first, size=size):
            place = next(p for p in path.parents if p.name.startswith("files"))
            is_folder = name in ("colmap", "openptv")
            return formats.load(place if is_folder else place / first, name, image_size=size)

        for file in files:
            changes = TREE if file.endswith(TREES) else TEXT
            others = {other: data for other, data in content.items() if other != file}
            key = f"{name} {file} {sum(name in one for one in found)}"
            found[key] = Reader(file, load, (content[file],), changes, others)
        every.append(content[first])
    for end in (".json", ".toml", ".yaml", ".txt", ".xml"):
        found[f"format unknown {end}"] = Reader(f"rig{end}", formats.load, tuple(every), TREE)
    binary = _colmap_binary()
    for name, content in binary.items():
        others = {other: data for other, data in binary.items() if other != name}
        found[f"COLMAP {name}"] = Reader(
            name, lambda path: formats.load(path.parent, "colmap"), (content,), BINARY, others
        )
    return found


def _colmap_binary():
    cameras = struct.pack("<QIiQQ4d", 2, 1, 1, 9, 7, 8, 8, 4.5, 3.5)
    cameras += struct.pack("<IiQQ5d", 2, 7, 9, 7, 8, 8, 4.5, 3.5, 0.9)
    images = struct.pack("<Q", 2)
    for number in (1, 2):
        images += struct.pack("<I7dI", number, 1, 0, 0, 0, number, 0, 9, number)
        images += b"%d/a.png\0" % number + struct.pack("<QddQ", 1, 1.5, 2.5, 2**64 - 1)
    rigs = struct.pack("<QIIiIiIB7d", 1, 1, 2, 0, 1, 0, 2, 1, 1, 0, 0, 0, 1, 0, 0)
    return {"cameras.bin": cameras, "images.bin": images, "rigs.bin": rigs}


def _scans(folder):
    R, t = look_at([90.0, 20, 30], [0, 0, 0], [0, 1, 0])
    camera = Camera("cam0", SIZE, [[80.0, 0, 4], [0, 80.0, 3], [0, 0, 1]], R=R, t=t)
    rig, grid = Rig((camera,), "mm", "somewhere"), VoxelGrid((2, 3, 4), 0.5)
    save_rig(rig, folder / "one.yaml")
    save_ray_table(RayTable.of(camera), folder / "rays.npz")
    rays = (folder / "rays.npz").read_bytes()
    listed = b"format: emission-rig\nversion: 1\ncameras: [{name: a, ray_table: rays.npz}]\n"
    write_volume(folder / "truth.npz", np.ones((2, 3, 4), np.float32), grid)
    formats.save(rig, folder / "transforms.json")
    transforms = (folder / "transforms.json").read_bytes().replace(b".png", b".tif")
    image = _tiffs()[2]
    others = {
        "rig.yaml": (folder / "one.yaml").read_bytes(),
        "a.tif": image,
        "images/cam0.tif": image,
        "truth.npz": (folder / "truth.npz").read_bytes(),
    }

    def load(path):
        return load_scan(path).read()

    def table(path):
        return load_ray_table("a", path.name, path.parent)

    return {
        "ray table": Reader("rays.npz", table, (rays,), ARCHIVE),
        "rig of a ray table": Reader("rig.yaml", load_rig, (listed,), TREE, {"rays.npz": rays}),
        "scan.yaml": Reader("scan.yaml", load, (_SCAN,), TREE, others),
        "scan of transforms.json": Reader("transforms.json", load, (transforms,), TREE, others),
        "world file": Reader("world.yaml", lambda path: load_world(path, rig), _WORLDS, TREE),
    }


_SCAN = b"""format: emission-scan
version: 1
rig: rig.yaml
grid: {shape: [3, 4, 5], spacing: 0.5, center: [0, 0, 0]}
frames:
  - {name: "0001", images: {cam0: a.tif}}
corrections:
  dark: 0.01
  flat: {cam0: a.tif}
  gain: {cam0: 1.02}
  mask: {cam0: a.tif}
  bayer: {cam0: RGGB}
  channel: {cam0: g}
  saturation: 0.98
  bit_depth: 12
truth: truth.npz
effects: {gain_spread: 0.1, absorption: 0.1, gains: {cam0: 1.0}}
"""

_WORLDS = (
    b"cam0: [0, 0, 5]\ncam1: [1, 0, 5]\ncam2: [0, 1, 5]\nrescale: true\n",
    b"R: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]\nt: [1, 2, 3]\nlength_unit: cm\n",
    b"origin: [0, 0, 1]\nx_axis: [1, 0, 0]\nxy_plane: [0, 1, 0]\nworld_frame: the table\n",
    b"points: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nbecome: [[0, 0, 0], [0, 2, 0], [-2, 0, 0]]\n"
    b"rescale: true\n",
)


def _volumes(folder):
    data = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    found = {}
    for suffix, more, changes in (
        (".npz", (), ARCHIVE),
        (".vti", (), (*TEXT, *BINARY)),
        (".nrrd", _nrrds(data), (*TEXT, *BINARY)),
    ):
        write_volume(folder / f"v{suffix}", data, VoxelGrid((2, 3, 4), 0.5))
        own = (folder / f"v{suffix}").read_bytes()
        found[f"volume {suffix}"] = Reader(f"v{suffix}", read_volume, (own, *more), changes)
    np.save(folder / "v.npy", data)
    own = (folder / "v.npy").read_bytes()
    bare = functools.partial(read_volume, spacing=0.5)
    found["volume .npy"] = Reader("v.npy", bare, (own,), (*TEXT, *BINARY))
    found["volume .mha"] = Reader("v.mha", read_volume, _mhas(data), (*TEXT, *BINARY))
    for suffix, pack in ((".nii", bytes), (".nii.gz", gzip.compress)):
        sample = pack(_nifti(data))
        found[f"volume {suffix}"] = Reader(f"v{suffix}", read_volume, (sample,), BINARY)
    return found


def _nrrds(data):
    head = "NRRD0004\ntype: float\ndimension: 3\nsizes: 2 3 4\nencoding: {}\nendian: little\n\n"
    values = data.tobytes()
    return tuple(
        head.format(encoding).encode() + pack(values)
        for encoding, pack in (("raw", bytes), ("gzip", functools.partial(gzip.compress, mtime=0)))
    )


def _mhas(data):
    """Return MetaImages, plain and packed."""
    values = data.tobytes(order="F")
    packed = zlib.compress(values)
    head = (
        b"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n%s"
        b"TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 1 2 3\nElementSpacing = 1 1 2\n"
        b"DimSize = 2 3 4\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n"
    )
    length = b"CompressedData = True\nCompressedDataSize = %d\n" % len(packed)
    return head % b"" + values, head % length + packed


def _nifti(data):
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *data.shape, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 16, 32)
    struct.pack_into("<9f", head, 76, 1, 1, 1, 2, 1, 1, 1, 1, 352)
    struct.pack_into("<h", head, 254, 1)
    struct.pack_into("<12f", head, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2, 0)
    head[344:348] = b"n+1\0"
    return bytes(head) + data.tobytes(order="F")


def _images(folder):
    found = Found(np.arange(3), np.ones((3, 2)), 1.0, "", None)
    nothing = Found.nothing("too dark")
    write_cache(folder / "cache", {"a": (found, SIZE), "b": (nothing, SIZE)})
    cache = (folder / "cache").read_bytes()
    grey = (np.arange(63).reshape(7, 9) * 4).astype(np.uint8)

    def coded(ending, *images):
        return tuple(cv2.imencode(ending, image)[1].tobytes() for image in images)

    pngs = coded(".png", grey, grey.astype(np.uint16) * 200, np.dstack([grey] * 3))
    jpeg, wide = coded(".jpg", grey), np.arange(6, dtype=">u2").tobytes()
    pnms = (b"P2\n3 2\n9\n1 2 3 4 5 6\n", b"P3\n1 2\n# a comment\n255\n1 2 3 4 5 6\n",
            b"P5 3 2 4095\n" + wide, b"P6 1 2 255\n" + bytes(6))  # fmt: skip
    every = (*pngs, *_tiffs(), *jpeg, *coded(".bmp", grey), *coded(".webp", grey), *pnms)

    def image(path):
        read_image(path, 12)
        is_integer_image(path)

    def noted(path):
        image_notes({"cam": [path]})
        read_still(path)

    return {
        "image .tif": Reader("a.tif", image, _tiffs(), BINARY),
        "image .png": Reader("a.png", read_image, pngs, PNG),
        "image .jpg": Reader("a.jpg", read_image, jpeg, BINARY),
        "image .pgm": Reader("a.pgm", read_image, pnms, (*TEXT, *BINARY)),
        "notes on images": Reader("a.tif", noted, every, PNG),
        "calibration image": Reader("a.tif", read_source, every, PNG),
        "detection cache": Reader("found.npz", read_cache, (cache,), ARCHIVE),
    }


def _tiffs():
    def tiff(image, **settings):
        file = io.BytesIO()
        tifffile.imwrite(file, image, **{"photometric": "minisblack", "metadata": None} | settings)
        return file.getvalue()

    small = np.arange(63, dtype=np.float32).reshape(7, 9)
    whole = small.astype(np.uint16)
    by_opencv = (
        cv2.imencode(".tif", image, [cv2.IMWRITE_TIFF_COMPRESSION, code])[1].tobytes()
        for image in (whole, whole.astype(np.uint8))
        for code in (5, 32773)  # LZW and PackBits
    )
    return (
        tiff(small),
        tiff(small, compression="zlib"),
        tiff(whole, bigtiff=True),
        tiff(whole, byteorder=">", software="x"),
        tiff(whole, compression="zlib", predictor=2),
        tiff(whole, tile=(16, 16)),
        tiff(whole, tile=(16, 16), compression="zstd"),
        tiff(whole.astype(np.uint8), compression="jpeg"),
        tiff(small, compression="lzw", predictor=3),
        tiff(np.stack([whole, whole])),
        tiff(whole, bitspersample=12),
        tiff(whole.astype(np.int32), compression="packbits"),
        tiff(small.astype(np.float16), compression="lzw"),
        tiff(np.dstack([whole, whole]), planarconfig="contig", extrasamples=["unassalpha"]),
        tiff(whole, photometric="cfa", extratags=[(274, "H", 1, 6, True)]),
        *by_opencv,
    )


def read_film(path):
    """Read some frames of a film, and what its file says of them."""
    recording = open_recording(path)
    assert recording.timestamps is None or len(recording.timestamps) == recording.n_frames
    try:
        for index in range(min(recording.n_frames, 3)):
            recording.read(index)
    finally:
        getattr(recording, "close", int)()  # HDF5 goes on with a file that is still open


def _films(folder):
    def written(make, name=None, **settings):
        place = folder / f"films {len(list(folder.glob('films *')))}"
        place.mkdir()
        path, _ = make(place, **settings)
        return (place / name if name else split_member(path)[0]).read_bytes()

    def in_zarr(path):
        read_film(next(one for one in path.parents if one.suffix == ".zarr"))

    photron = [written(film_files.photron, name, bits=12) for name in ("a.cihx", "a.mraw")]
    cih = written(film_files.photron, "a.cih", bits=12, suffix=".cih")
    cines = [written(film_files.cine, bits=bits, packing=packing)
             for bits, packing in ((8, 0), (16, 0), (16, 256), (16, 1024))]  # fmt: skip
    im7 = [written(film_files.im7, packing=packing) for packing in (2, 3)]
    im7 += [written(film_files.readim7_s_images, "cam/B00009.im7", is_packed=one)
            for one in (False, True)]  # fmt: skip
    hdf5 = [written(make) for make in (film_files.nexus, film_files.nexus_in_chunks)]
    numpy = [written(make)
             for make in (film_files.numpy_array, film_files.numpy_array_of_columns)]  # fmt: skip
    chunk = "a.zarr/c/0/0/0"
    zarr = {name: written(film_files.zarr_array, name) for name in ("a.zarr/zarr.json", chunk)}
    videos = _videos(folder)
    return {
        "film .tif": Reader("a.tif", read_film, _stacks(), BINARY),
        "film .avi": Reader("a.avi", read_film, videos, BINARY),
        "film .cine": Reader("a.cine", read_film, cines, BINARY),
        "film .mraw": Reader("a.mraw", read_film, photron[1:], BINARY, {"a.cihx": photron[0]}),
        "film .cihx": Reader("a.cihx", read_film, photron[:1], TEXT, {"a.mraw": photron[1]}),
        "film .cih": Reader("a.cih", read_film, [cih], TEXT, {"a.mraw": photron[1]}),
        "film .im7": Reader("a.im7", read_film, im7, BINARY),
        "film .h5": Reader("a.h5", read_film, hdf5, BINARY),
        "film .npy": Reader("a.npy", read_film, numpy, BINARY),
        "film zarr.json": Reader("a.zarr/zarr.json", in_zarr, [zarr["a.zarr/zarr.json"]], TREE,
                                 zarr),
        "film chunk": Reader(chunk, in_zarr, [zarr[chunk]], BINARY, zarr),
    }  # fmt: skip


def _stacks():
    made = []
    for settings in ({}, {"compression": "zlib", "bigtiff": True}, {"tile": (16, 16)}):
        file = io.BytesIO()
        stack = np.arange(189, dtype=np.uint16).reshape(3, 7, 9)
        tifffile.imwrite(file, stack, photometric="minisblack", **settings)
        made.append(file.getvalue())
    return tuple(made)


def _videos(folder):
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # as `Video` does, but before writing
    made = []
    for code in ("MJPG", "FFV1"):
        path = str(folder / "written.avi")
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*code), 10, (32, 24))
        for level in (60, 90, 200):
            writer.write(np.full((24, 32, 3), level, np.uint8))
        writer.release()
        made.append((folder / "written.avi").read_bytes())
    return tuple(made)


def _learned(folder):
    files, path = [], folder / "a.pt"
    for encoder in (
        Encoder("relative", variant="batch-norm", blocks=1, channels=2),
        Encoder("absolute", blocks=2, channels=2),
        Encoder("optics", blocks=1, channels=2, shown=("upstream emission",)),
    ):
        save_encoder(encoder, path)
        files.append(path.read_bytes())
    legacy = io.BytesIO()
    content = torch.load(path, weights_only=True)
    torch.save(content, legacy, _use_new_zipfile_serialization=False)
    save_training(path, "a problem", {"history": [2], "voxels": torch.ones(8)})

    def resume(file):
        return load_training(file, "a problem")

    return {
        "encoder": Reader("a.pt", load_encoder, (*files, legacy.getvalue()), ARCHIVE),
        "checkpoint": Reader("c.pt", resume, (path.read_bytes(),), ARCHIVE),
    }


GROUPS = {"rigs": _rigs, "scans": _scans, "volumes": _volumes, "images": _images, "films": _films,
          "learned": _learned}  # fmt: skip
"""Functions that return readers by name; they are given a folder for what the writers write."""
