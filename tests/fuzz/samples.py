"""Every reader of files, with small valid files, most of them by the project's own writers."""

import base64
import bz2
import functools
import gzip
import io
import json
import os
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import cv2
import film_files
import numpy as np
import tifffile
import torch
import yaml
from mutations import ARCHIVE, BINARY, PNG, TEXT, TREE

from rigs import Camera, Distortion, RayTable, Rig, formats, look_at
from rigs.calibrate.detect import _detection_cache
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
from rigs.recordings.film_formats.video_opencv import OpenCVVideo
from tomo import VoxelGrid, load_scan
from tomo.io import read_volume, write_volume
from tomo.wernet import Encoder, load_encoder, save_encoder
from tomo.wernet.files import load_training, save_training

EYE = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]
K = [[80.0, 0, 4], [0, 80.0, 3], [0, 0, 1]]
LENSES = {
    "brown": (-0.2, 0.05, 0.001, -0.002),
    "fisheye": (0.02, -0.01, 0.003, -0.001),
    "none": (),
}


@dataclass(frozen=True)
class Reader:
    """One reader: the file that is damaged, how it is read and changed, and what lies with it."""

    file: str
    read: Callable
    samples: tuple[bytes, ...]
    changes: tuple
    others: Mapping[str, bytes] = field(default_factory=dict)


def readers(folder):
    """Return every reader by name; ``folder`` is for what the writers write."""
    rigs = _rigs(folder) | _models() | _tools(folder)
    recordings = _images(folder) | _films(folder)
    return rigs | _scans(folder) | _volumes(folder) | recordings | _learned(folder)


def small_rig(*models):
    """Return a rig of one small camera for each lens named."""
    cameras = []
    for number, model in enumerate(models):
        R, t = look_at([90.0 + 10 * number, 20, 30 - 40 * number], [0, 0, 0], [0, 1, 0])
        lens = Distortion(model, LENSES[model])
        cameras.append(Camera(f"cam{number}", (9, 7), K, lens, R, t, status="calibrated"))
    return Rig(tuple(cameras), "mm", "somewhere")


def _rigs(folder):
    rig = small_rig("brown", "none")

    def written(name, format_name=None, rig=rig):
        formats.save(rig, folder / name, format_name)
        return (folder / name).read_bytes()

    def of_format(name, up=0):
        return lambda path: formats.load(path if not up else path.parents[up - 1], name)

    save_rig(rig, folder / "own.yaml")
    own = (folder / "own.yaml").read_bytes()
    save_ray_table(RayTable.of(small_rig("none")[0]), folder / "rays.npz")
    rays = (folder / "rays.npz").read_bytes()
    listed = b"format: emission-rig\nversion: 1\ncameras: [{name: a, ray_table: rays.npz}]\n"
    formats.save(rig, folder / "model", "colmap")
    model = {f"{name}.txt": (folder / "model" / f"{name}.txt").read_bytes()
             for name in ("cameras", "images", "rigs")}  # fmt: skip
    middlebury = b"1\na.png 90 0 32 0 90 24 0 0 1 1 0 0 0 1 0 0 0 1 0.1 0.2 5\n"
    transforms = (written("transforms.json"), written("transforms.json", rig=small_rig("fisheye")))
    kalibr = tuple(map(_kalibr, ("pinhole", "omni", "ds", "eucm")))
    opencv, project, (intrinsics, extrinsics) = written("a.yml"), _openptv(), _stereo()
    anything = (own, middlebury, *transforms, opencv, *kalibr, _multical(), _anipose(), _myptv())

    def stereo(path):
        return formats.load(path, image_size=(9, 7))

    def table(path):
        return load_ray_table("a", path.name, path.parent)

    return {
        "rig.yaml": Reader("rig.yaml", load_rig, (own, _SHORT_RIG, listed), TREE,
                           {"rays.npz": rays}),
        "ray table": Reader("rays.npz", table, (rays,), ARCHIVE),
        "Middlebury": Reader("a_par.txt", of_format("middlebury"), (middlebury,), TEXT,
                             {"a.png": _pngs()[0]}),
        **{f"COLMAP {name}": Reader(name, of_format("colmap", 1), (model[name],), TEXT, model)
           for name in model},
        "transforms.json": Reader("transforms.json", formats.load, transforms, TREE),
        "multical": Reader("calibration.json", of_format("multical"), (_multical(),), TREE),
        "Kalibr": Reader("camchain.yaml", of_format("kalibr"), kalibr, TREE),
        "anipose": Reader("calibration.toml", of_format("anipose"), (_anipose(),), TEXT),
        **{f"OpenPTV {name}": Reader(name, of_format("openptv", 2), (text,), TEXT, project)
           for name, text in list(project.items())[:2]},
        "OpenCV YAML": Reader("a.yml", of_format("opencv"), (opencv,), TREE),
        "OpenCV JSON": Reader("a.json", of_format("opencv"), (written("a.json"),), TREE),
        "OpenCV stereo": Reader("intrinsics.yml", stereo, (intrinsics,), TREE,
                                {"extrinsics.yml": extrinsics}),
        "MyPTV": Reader("cam1", of_format("myptv"), (_myptv(),), TEXT),
        **{f"format unknown {end}": Reader(f"rig{end}", formats.load, anything, TREE)
           for end in (".json", ".toml", ".yaml", ".txt")},
    }  # fmt: skip


def _models():
    """Models of structure from motion, in binary too, and bare matrices."""

    def of_format(name, up=0, size=(9, 7)):
        return lambda path: formats.load(path.parents[up - 1] if up else path, name,
                                         image_size=size)  # fmt: skip

    lenses = _colmap_lenses()
    binary, images = _colmap_binary(), {"images.txt": b"1 1 0 0 0 0 0 9 1 a.png\n\n"}
    R, t = look_at([30, 10, 200], [0, 0, 0])
    P = np.array(K) @ np.column_stack([R, t])
    table = "\n".join(f"{v!r},{v!r}" for v in (P / P[2, 3]).ravel()[:11].tolist())
    size, pyptv = {"a.png": _pngs()[0]}, (_pyptv(), _pyptv(1.46))
    return {
        **{f"COLMAP {name}": Reader(name, of_format("colmap", 1, None), (content,), BINARY, binary)
           for name, content in binary.items()},
        "COLMAP lenses": Reader("cameras.txt", of_format("colmap", 1), lenses, TEXT, images),
        "Bundler": Reader("bundle.out", of_format("bundler"), (_bundle(R, t),), TEXT,
                          {"list.txt": b"a.png\n"} | size),
        "Bundler list": Reader("list.txt", lambda path: formats.load(path.parent / "bundle.out"),
                               (b"a.png\n", b"C:\\x\\a.png 0 9\n"), TEXT,
                               {"bundle.out": _bundle(R, t)} | size),
        "projection": Reader("a.txt", of_format("projection"), _matrices(P), TEXT),
        "DLT": Reader("a.csv", of_format("dlt"), (table.encode(),), TEXT),
        "DLT bottom": Reader("a.csv", of_format("dlt_bottom"), (table.encode(),), TEXT),
        "pyptv": Reader("parameters_Run1.yaml", of_format("openptv"), pyptv, TREE,
                        {name: text for name, text in _openptv().items() if "cal/" in name}),
    }  # fmt: skip


def _tools(folder):
    """Rigs as other programs of the trade write them: YAML, XML, Python literals and JSON."""

    def of_format(name, size=None):
        return lambda path: formats.load(path, name, image_size=size)

    intri, extri = _easymocap()
    formats.save(small_rig("brown", "none"), folder / "storage.xml", "opencv")
    storage = (folder / "storage.xml").read_bytes()
    lists = _storage_of_lists()
    beside = {"extri.yml": extri}
    json_kinds = {
        "Gaussian splatting": ("cameras.json", "gaussian_splatting", _splats()),
    }
    every = (*(sample for *_, sample in json_kinds.values()), lists[2])
    return {
        "EasyMocap": Reader("intri.yml", of_format("easymocap", (9, 7)), (intri,), TREE, beside),
        "OpenCV XML": Reader("a.xml", of_format("opencv", (9, 7)), (storage, lists[1]), TEXT),
        "OpenCV lists": Reader("b.yml", of_format("opencv", (9, 7)), (lists[0],), TREE),
        "mrcal": Reader("a.cameramodel", of_format("mrcal"), (_mrcal(),), TEXT),
        "Metashape": Reader("cameras.xml", of_format("metashape"), (_metashape(),), TEXT),
        **{name: Reader(file, of_format(module, (9, 7)), (sample,), TREE)
           for name, (file, module, sample) in json_kinds.items()},
        "format unknown .xml": Reader("rig.xml", formats.load, (storage, _metashape()), TEXT),
        "format unknown of tools": Reader("list.json", formats.load, every, TREE),
        **{name: Reader(file, of_format(module, size), (text.encode(),), changes)
           for name, (file, module, size, text, changes) in _exports().items()},
    }  # fmt: skip


def _exports():
    """Rigs of motion capture and photogrammetry: file, format, size, text and changes."""
    eye = np.ravel(EYE).tolist()
    lens = {"intrinsicId": "2", "width": "9", "height": "7", "type": "brown", "sensorWidth": "36",
            "focalLength": "320", "pixelRatio": "1", "principalPoint": ["0.5", "0"],
            "distortionParams": ["-0.1", "0.05", "0", "0.001", "0"]}  # fmt: skip
    transform = {"rotation": [str(v) for v in eye], "center": ["0", "0", "-9"]}
    sfm = {"version": ["1", "2", "8"], "intrinsics": [lens],
           "views": [{"viewId": "0", "poseId": "1", "intrinsicId": "2", "path": "/d/a.png"}],
           "poses": [{"poseId": "1", "pose": {"transform": transform}}]}  # fmt: skip
    brown = {"projection_type": "brown", "width": 9, "height": 7, "focal_x": 9.0, "focal_y": 9.1,
             "c_x": 0.01, "k1": -0.1, "k2": 0.05, "p1": 1e-3, "p2": 0, "k3": 0}  # fmt: skip
    shot = {"rotation": [0.1, 0.2, 0.3], "translation": [0, 0, 9], "camera": "a"}
    r = " ".join(f'r{i + 1}{j + 1}="{EYE[i][j]}"' for i in range(3) for j in range(3))
    qca = (
        '<calibration><cameras><camera active="1" serial="7" viewrotation="0"><fov_video left="0" '
        f'top="0" right="8" bottom="6"/><transform x="0" y="0" z="9" {r}/><intrinsic skew="0" '
        'focalLengthU="5120" focalLengthV="5120" centerPointU="256" centerPointV="192" '
        'radialDistortion1="-0.1"/></camera></cameras></calibration>'
    )
    row = " ".join(map(str, eye))
    raw = f"S_00: 9 7\nK_00: 80 0 4 0 80 3 0 0 1\nD_00: -0.1 0 0 0 0\nR_00: {row}\nT_00: 0 0 9\n"
    pix4d = (
        "fileName imageWidth imageHeight\ncamera matrix K [3x3]\ncamera model m = K [R|-Rt] X\n\n"
        "a.png 9 7\n80 0 4\n0 80 3\n0 0 1\n-0.1 0.05 0\n0.001 0\n0 0 -9\n1 0 0\n0 1 0\n0 0 1\n"
    )
    captured = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n"
    captured += "a.png,1,2,3,10,20,30,300,0.01,0,-0.1,0.05,0,0.02,0.001,0\n"
    size = (9, 7)
    return {
        "AliceVision": ("a.sfm", "alicevision", None, json.dumps(sfm), TREE),
        "OpenSfM": ("r.json", "opensfm", None,
                    json.dumps([{"cameras": {"a": brown}, "shots": {"a.png": shot}}]), TREE),
        "Qualisys": ("a.qca.txt", "qualisys", None, qca, TEXT),
        "KITTI": ("c.txt", "kitti", None, raw, TEXT),
        "KITTI rectified": ("c.txt", "kitti", size, "P0: 80 0 4 0 0 80 3 0 0 0 1 0\n", TEXT),
        "Pix4D": ("p.txt", "pix4d", None, pix4d, TEXT),
        "RealityCapture": ("r.csv", "realitycapture", size, captured, TEXT),
    }  # fmt: skip


def _scans(folder):
    rig, grid = small_rig("none"), VoxelGrid((2, 3, 4), 0.5)
    save_rig(rig, folder / "one.yaml")
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

    return {
        "scan.yaml": Reader("scan.yaml", load, (_SCAN,), TREE, others),
        "scan of transforms.json": Reader("transforms.json", load, (transforms,), TREE, others),
        "world file": Reader("world.yaml", lambda path: load_world(path, rig), _WORLDS, TREE),
    }


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
        (".vti", _vtis(), (*TEXT, *BINARY)),
        (".nrrd", _nrrds(), (*TEXT, *BINARY)),
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
    _detection_cache.write(folder / "cache", {"a": (found, (9, 7)), "b": (nothing, (9, 7))})
    every = (*_pngs(), *_tiffs(), *_others())

    def image(path):
        read_image(path, 12)
        is_integer_image(path)

    def noted(path):
        image_notes({"cam": [path]})
        read_still(path)

    return {
        "image .tif": Reader("a.tif", image, _tiffs(), BINARY),
        "image .png": Reader("a.png", read_image, _pngs(), PNG),
        "image .jpg": Reader("a.jpg", read_image, (_jpeg(),), BINARY),
        "image .pgm": Reader("a.pgm", read_image, _pnms(), (*TEXT, *BINARY)),
        "notes on images": Reader("a.tif", noted, every, PNG),
        "calibration image": Reader("a.tif", read_source, every, PNG),
        "detection cache": Reader("found.npz", _detection_cache.read,
                                  ((folder / "cache").read_bytes(),), ARCHIVE),
    }  # fmt: skip


def read_film(path, opened=open_recording):
    """Read some frames of a film, and what its file says of them."""
    recording = opened(path)
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

    def by_opencv(path):
        read_film(path, OpenCVVideo)

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
        "film .avi by OpenCV": Reader("a.avi", by_opencv, videos, BINARY),
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


_SHORT_RIG = b"""format: emission-rig
version: 1
length_unit: mm
convention: opencv
cameras:
  - {name: left, image_size: [9, 7], position: [-30, 0, 50], look_at: [0, 0, 0], up: [0, 1, 0],
     focal_length: 25, pixel_pitch: [0.0074, 1e-3], principal_point: [4, 3],
     distortion: {model: none, coefficients: []}, status: virtual,
     optics: {focal_length: 25, f_number: 8, focus_distance: 300, pixel_pitch: 0.0074}}
volume: {shape: [3, 4, 5], spacing: 0.5, center: [0, 0, 0]}
calibration: {date: 2020-01-01, ray_miss: 0.01}
"""

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


def _kalibr(model):
    lens = {"pinhole": "radtan", "omni": "radtan"}.get(model, "none")
    first = {"pinhole": [], "omni": [0.8], "ds": [-0.2, 0.59], "eucm": [0.6, 1.1]}[model]
    camera = {
        "camera_model": model,
        "intrinsics": [*first, 8.0, 8.0, 4.0, 3.0],
        "distortion_model": lens,
        "distortion_coeffs": [0.0, 0.01, 0, 0] if lens == "radtan" else [],
        "resolution": [9, 7],
    }
    link = np.eye(4)
    link[0, 3] = 0.1
    other = json.loads(json.dumps(camera | {"T_cn_cnm1": link.tolist()}))  # no aliases
    return yaml.safe_dump({"cam0": camera, "cam1": other}, default_flow_style=None).encode()


def _multical():
    camera = {"model": "standard", "image_size": [9, 7], "K": K, "dist": [[0.1, 0, 0, 0, 0]]}
    poses = {name: {"R": EYE, "T": [0, 0, 1]} for name in ("a", "b_to_a")}
    return json.dumps({"cameras": {"a": camera, "b": camera}, "camera_poses": poses}).encode()


def _anipose():
    rows = f"size = [9, 7]\nmatrix = {K}\ndistortions = [0.1, 0, 0, 0, 0]\n"
    pose = "translation = [0, 0, 1]\nfisheye = false\n"
    return (
        f'[cam_0]\nname = "a"\n{rows}rotation = [0.1, 0, 0]\n{pose}\n'
        f"[cam_1]\n{rows}rotation = {EYE}\n{pose}\n[metadata]\nadjusted = false\n"
    ).encode()


def _stereo():
    texts = []
    for matrices in (
        {"M1": np.array(K), "D1": np.zeros((1, 5)), "M2": np.array(K), "D2": np.zeros((1, 5))},
        {"R": np.eye(3), "T": np.array([[1.0], [0], [0]])},
    ):
        flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
        storage = cv2.FileStorage("a.yml", flags)
        for name, matrix in matrices.items():
            storage.write(name, matrix)
        texts.append(storage.releaseAndGetString().encode())
    return texts


def _colmap_lenses():
    lines = (
        "1 FOV 9 7 8 8 4.5 3.5 0.9",
        "1 DIVISION 9 7 8 8 4.5 3.5 -0.1",
        "1 EUCM 9 7 8 8 4.5 3.5 0.6 1.1",
        "1 RADIAL_FISHEYE 9 7 8 4.5 3.5 0.01 0.002",
        "1 THIN_PRISM_FISHEYE 9 7 8 8 4.5 3.5 0.01 0.002 0.001 0.002 0.003 0 0.002 0.001",
    )
    return tuple(f"{line}\n".encode() for line in lines)


def _colmap_binary():
    cameras = struct.pack("<QIiQQ4d", 2, 1, 1, 9, 7, 8, 8, 4.5, 3.5)
    cameras += struct.pack("<IiQQ5d", 2, 7, 9, 7, 8, 8, 4.5, 3.5, 0.9)
    images = struct.pack("<Q", 2)
    for number in (1, 2):
        images += struct.pack("<I7dI", number, 1, 0, 0, 0, number, 0, 9, number)
        images += b"%d/a.png\0" % number + struct.pack("<QddQ", 1, 1.5, 2.5, 2**64 - 1)
    rigs = struct.pack("<QIIiIiIB7d", 1, 1, 2, 0, 1, 0, 2, 1, 1, 0, 0, 0, 1, 0, 0)
    return {"cameras.bin": cameras, "images.bin": images, "rigs.bin": rigs}


def _rows(matrix):
    return "".join(" ".join(map(repr, row)) + "\n" for row in np.asarray(matrix).tolist())


def _bundle(R, t):
    turn = np.diag([1.0, -1, -1])
    head = "# Bundle file v0.3\n1 1\n90.0 -0.1 0.05\n"
    return (
        head + _rows(turn @ R) + _rows([turn @ t]) + "1 2 3\n255 0 0\n1 0 5 1.5 2.5\n"
    ).encode()


def _matrices(P):
    return _rows(P).encode(), f"CONTOUR\n{_rows(P)}".encode(), _rows(P).replace(" ", ",").encode()


def _pyptv(glass=1.0):
    values = {"imx": 9, "imy": 7, "pix_x": 0.012, "pix_y": 0.0125, "chfield": 0}
    values |= {"mmp_n1": 1.0, "mmp_n2": glass, "mmp_n3": 1.0, "mmp_d": 6.0, "splitter": False}
    return yaml.safe_dump({"num_cams": 1, "ptv": values | {"img_cal": ["cal/cam1.tif"]}}).encode()


def _storage(ending, fields):
    kinds = {".yml": cv2.FILE_STORAGE_FORMAT_YAML, ".xml": cv2.FILE_STORAGE_FORMAT_XML,
             ".json": cv2.FILE_STORAGE_FORMAT_JSON}  # fmt: skip
    flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kinds[ending]
    storage = cv2.FileStorage(f"a{ending}", flags)
    for name, value in fields.items():
        is_list = isinstance(value, (list, dict))
        if is_list:
            kind = cv2.FILE_NODE_SEQ if isinstance(value, list) else cv2.FILE_NODE_MAP
            storage.startWriteStruct(name, kind)
        items = value.items() if isinstance(value, dict) else [("", v) for v in value or []] \
            if is_list else [(name, value)]  # fmt: skip
        for key, item in items:
            storage.write(key, item)
        if is_list:
            storage.endWriteStruct()
    return storage.releaseAndGetString().encode()


def _easymocap():
    intri, extri = {"names": ["1", "2"]}, {}
    for name in ("1", "2"):
        intri |= {f"K_{name}": np.array(K), f"dist_{name}": np.full((1, 5), 0.01)}
        intri |= {f"H_{name}": 7, f"W_{name}": 9} if name == "1" else {}
        extri |= {f"R_{name}": np.zeros((3, 1)), f"Rot_{name}": np.eye(3)}
        extri[f"T_{name}"] = np.full((3, 1), 9.0)
    return _storage(".yml", intri), _storage(".yml", extri)


def _storage_of_lists():
    fields = {"image_size": [9, 7], "camera_matrix": [np.array(K)] * 2,
              "distortion_coefficients": [np.zeros((1, 5))] * 2, "rvecs": [np.zeros((3, 1))] * 2,
              "tvecs": [np.ones((3, 1))] * 2}  # fmt: skip
    numbered = {"nCameras": 1, "camera_matrix_0": np.array(K),
                "camera_distortion_0": np.zeros((1, 5)), "camera_pose_0": np.eye(4)}  # fmt: skip
    return _storage(".yml", fields), _storage(".xml", fields), _storage(".json", numbered)


def _mrcal():
    return (
        b"# made by hand\n{\n    'lensmodel': 'LENSMODEL_OPENCV4',\n    'intrinsics': "
        b"[80., 80., 4., 3., 0.1, 0.01, 1e-3, -1e-3,],\n    'valid_intrinsics_region': [\n"
        b"    [1, 1],\n    ],\n    'extrinsics': [0.1, 0, 0, 1, 2, 300],\n"
        b"    'imagersize': [ 9,7 ],\n    'optimization_inputs': b'P)h>@6',\n}\n"
    )


def _metashape():
    sensors = "".join(
        f'<sensor id="{i}" label="s" type="{kind}"><resolution width="9" height="7"/>'
        f'<calibration type="{kind}" class="adjusted"><resolution width="9" height="7"/>'
        f"<f>80.5</f><cx>-0.5</cx><cy>0.25</cy><k1>0.01</k1>{more}</calibration></sensor>"
        for i, (kind, more) in enumerate(
            (("frame", "<k4>0.1</k4><p1>0.001</p1><b1>0.5</b1>"), ("fisheye", "<k4>0.01</k4>"))
        )
    )
    cameras = "".join(
        f'<camera id="{i}" sensor_id="{i % 2}" component_id="0" label="c{i}.jpg"><transform>1 0 0 '
        f"{i} 0 1 0 0 0 0 1 -9 0 0 0 1</transform><orientation>1</orientation></camera>"
        for i in range(3)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n'
        f'<chunk label="Chunk 1" enabled="true"><sensors next_id="2">{sensors}</sensors>\n'
        '<components><component id="0"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation>'
        "<translation>1 2 3</translation><scale>2.5</scale></transform></component></components>"
        f'\n<cameras next_id="3">{cameras}</cameras>\n'
        '<reference>LOCAL_CS["Local (m)",UNIT["metre",1]]</reference></chunk></document>\n'
    ).encode()


def _splats():
    camera = {"width": 9, "height": 7, "position": [0, 0, -9], "rotation": EYE, "fx": 80.0,
              "fy": 81.0}  # fmt: skip
    return json.dumps(
        [{"id": i, "img_name": f"{n}_{i}", **camera} for i in (1, 2) for n in "a"]
    ).encode()


def _openptv():
    ori = "120 50 600\n-0.05 0.2 0.01\n" + "0 " * 9 + "\n0.3 -0.2 60\n0 0 50\n"
    par = "1\nimg/cam1.1\ncal/cam1.tif\n1\n0\n1\n9\n7\n0.012\n0.0125\n0\n1\n1\n1\n6\n"
    return {
        "parameters/ptv.par": par.encode(),
        "cal/cam1.tif.ori": ori.encode(),
        "cal/cam1.tif.addpar": b"-4e-4 1e-7 0 2e-5 -3e-5 1.01 2e-3\n",
    }


def _myptv():
    rows = "6e-3 -1e-2 -7e-6 9e-7 1.2e-5\n9e-3 -9e-3 -3e-6 9e-6 -8e-6\n0 0 0 0 0\n"
    return f"Tsai model camera\ncam1\n9 7\n1 2 500\n0.1 0.2 0.3\n900\n1 -1\n{rows}".encode()


def _vtis():
    values = np.arange(60, dtype="<f4").tobytes()
    head = (
        '<VTKFile type="ImageData" byte_order="LittleEndian"{}>\n<ImageData WholeExtent="0 2 0 3 '
        '0 4" Origin="0 0 0" Spacing="1 1 1">\n<Piece Extent="0 2 0 3 0 4"><PointData>\n'
        '<DataArray type="Float32" {}</PointData></Piece></ImageData>'
    )
    packed = zlib.compress(values)
    sizes = struct.pack("<4I", 1, 240, 240, len(packed))
    coded = base64.b64encode(struct.pack("<I", 240) + values).decode()
    blocks = base64.b64encode(sizes).decode() + base64.b64encode(packed).decode()
    by_zlib = ' compressor="vtkZLibDataCompressor"'
    made = [
        head.format(attributes, f'format="{kind}">{text}</DataArray>').encode() + b"</VTKFile>"
        for attributes, kind, text in (
            ("", "ascii", "1 2 3 4 5 " * 12),
            ("", "binary", coded),
            (by_zlib, "binary", blocks),
        )
    ]
    appended = head.format(by_zlib, 'format="appended" offset="0"/>').encode()
    raw = b'<AppendedData encoding="raw">_' + sizes + packed + b"</AppendedData></VTKFile>"
    return (*made, appended + raw)


def _nrrds():
    head = "NRRD0004\ntype: float\ndimension: 3\nsizes: 2 3 4\nencoding: {}\nendian: little\n"
    head += "space: 3D-right-handed\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n"
    head += "space origin: (0,0,0)\n{}\n"
    by_axis = (
        "NRRD0004\ntype: float\ndimension: 3\nsizes: 2 3 4\nencoding: raw\nendian: little\n"
        "spacings: 1 2 3\naxis mins: -1 6 0\naxis maxs: 1 0 nan\ncenterings: cell cell node\n"
        'units: "mm" "mm" "mm"\n\n'
    )
    values = np.arange(24, dtype="<f4").tobytes()
    return by_axis.encode() + values, *(
        head.format(encoding, fields).encode() + data
        for encoding, fields, data in (
            ("raw", "", values),
            ("gzip", "", gzip.compress(values, mtime=0)),
            ("bzip2", "", bz2.compress(values)),
            ("ascii", "", " ".join(map(str, range(24))).encode()),
            ("raw", "byte skip: -1\n", values),
        )
    )


def _tiffs():
    def tiff(image, **settings):
        file = io.BytesIO()
        settings = {"photometric": "minisblack", "metadata": None} | settings
        tifffile.imwrite(file, image, **settings)
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


def _pnms():
    wide = np.arange(6, dtype=">u2").tobytes()
    return (
        b"P2\n3 2\n9\n1 2 3 4 5 6\n",
        b"P3\n1 2\n# a comment\n255\n1 2 3 4 5 6\n",
        b"P5 3 2 4095\n" + wide,
        b"P6 1 2 255\n" + bytes(6),
    )


def _grey():
    return (np.arange(63).reshape(7, 9) * 4).astype(np.uint8)


def _pngs():
    images = (_grey(), _grey().astype(np.uint16) * 200, np.dstack([_grey()] * 3))
    return tuple(cv2.imencode(".png", image)[1].tobytes() for image in images)


def _jpeg():
    return cv2.imencode(".jpg", _grey())[1].tobytes()


def _others():
    made = (cv2.imencode(end, _grey())[1].tobytes() for end in (".bmp", ".pgm", ".webp"))
    return (_jpeg(), *made, *_pnms())
