"""Every reader there is, with the files it starts from and how they are changed."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from _stress import fuzzing_files as binary
from _stress import fuzzing_seeds as seeds
from _stress.fuzzing_containers import change_png, change_zip
from _stress.fuzzing_mutations import BINARY, TEXT, TREE, Mutation

MOST_RAYS = 1 << 14
"""Pixels of the largest table of rays that a reader makes here; `rigs` allows 2^24."""


@dataclass(frozen=True)
class Reader:
    """One reader and its files.

    Attributes
    ----------
    name : str
    file : str
        The file that is changed, in a folder of its own.
    read : callable
        Reads it, given its path.
    seeds : tuple of bytes
        The file as it may be.
    mutations : tuple of Mutation
    beside : mapping
        The other files of the folder.
    links : tuple of str
        Other names of the file.
    """

    name: str
    file: str
    read: Callable[[Path], object]
    seeds: tuple[bytes, ...]
    mutations: tuple[Mutation, ...]
    beside: Mapping[str, bytes] = field(default_factory=dict)
    links: tuple[str, ...] = ()


def reader_of(name: str, folder: Path) -> Reader:
    """Return a reader by its name; ``folder`` is for the files that the writers write."""
    make = next(make for make, names in _MADE_BY.items() if name in names)
    return next(reader for reader in _made(make, folder) if reader.name == name)


@functools.cache
def _made(make: Callable[[Path], list[Reader]], folder: Path) -> list[Reader]:
    """Make readers that share their files, once."""
    own = folder / make.__name__.strip("_")
    own.mkdir(parents=True)
    return make(own)


def in_groups(names: Iterable[str]) -> list[str]:
    """Return readers with those beside each other that are made together, long ones first."""
    groups = list(_MADE_BY.values())

    def place(name: str) -> tuple[int, bool]:
        return next(n for n, group in enumerate(groups) if name in group), name not in OFTEN

    return sorted(names, key=place)


def _rigs(folder: Path) -> list[Reader]:
    from rigs import RayTable, formats
    from rigs.file import load_rig, save_rig
    from rigs.formats import _image_size
    from rigs.ray_file import load_ray_table, save_ray_table

    # tables of rays take as much as the camera has pixels, which is no matter of the file's size
    _image_size.MOST_RAYS = MOST_RAYS
    rig = seeds.rig("brown", "none")
    one = seeds.rig("none")
    table = RayTable.of(one[0])
    save_ray_table(table, folder / "rays.npz")
    rays = (folder / "rays.npz").read_bytes()

    def written(name: str, format_name: str | None = None, of=rig) -> bytes:
        return seeds.written(lambda path: formats.save(of, path, format_name), folder, name)

    def read(path: Path) -> object:
        return formats.load(path)

    own = seeds.written(lambda path: save_rig(rig, path), folder, "rig.yaml")
    listed = b"format: emission-rig\nversion: 1\ncameras: [{name: a, ray_table: rays.npz}]\n"
    formats.save(rig, folder / "model", "colmap")
    colmap = {
        name: (folder / "model" / name).read_bytes()
        for name in ("cameras.txt", "images.txt", "rigs.txt")
    }
    project, (intrinsics, extrinsics) = seeds.openptv(), seeds.stereo()
    middlebury = b"1\na.png 90 0 32 0 90 24 0 0 1 1 0 0 0 1 0 0 0 1 0.1 0.2 5\n"
    picture = binary.png_seeds()[0]
    transforms = (
        written("transforms.json"),
        written("fish/transforms.json", of=seeds.rig("fisheye")),
    )
    opencv, as_json = written("a.yml"), written("a.json")
    kalibr = tuple(map(seeds.kalibr, ("pinhole", "omni", "ds", "eucm")))
    anything = (own, middlebury, *transforms, opencv, *kalibr, seeds.multical(), seeds.anipose())
    anything += (seeds.myptv(), b"\n" * 60000, b" " * 60000, b"1\n" * 30000, b"1" + b"\n" * 60000)
    anything += (b"a.a" * 20000, b"1\n" + b"a." * 30000, b"\n\tcam0:" * 9000)

    def stereo(path: Path) -> object:
        return formats.load(path, image_size=(9, 7))

    return [
        Reader("rig.yaml", "rig.yaml", load_rig, (own, seeds.short_rig(), listed), TREE,
               {"rays.npz": rays}),
        Reader("ray table", "rays.npz", lambda path: load_ray_table("a", path.name, path.parent),
               binary.npz_seeds(folder / "rays.npz", "rays"), (change_zip, change_zip, *BINARY)),
        Reader("Middlebury", "a_par.txt", lambda p: formats.load(p, "middlebury"), (middlebury,),
               TEXT, {"a.png": picture}),
        *(Reader(f"COLMAP {name}", f"{name}.txt", lambda p: formats.load(p.parent, "colmap"),
                 (colmap[f"{name}.txt"],), TEXT, colmap)
          for name in ("cameras", "images", "rigs")),
        Reader("transforms.json", "transforms.json", read, transforms, TREE),
        Reader("multical", "calibration.json", lambda p: formats.load(p, "multical"),
               (seeds.multical(),), TREE),
        Reader("Kalibr", "camchain.yaml", lambda p: formats.load(p, "kalibr"), kalibr, TREE),
        Reader("anipose", "calibration.toml", lambda p: formats.load(p, "anipose"),
               (seeds.anipose(),), TEXT),
        *(Reader(f"OpenPTV {name}", file, lambda p: formats.load(p.parent.parent, "openptv"),
                 (project[file],), TEXT, project)
          for name, file in (("project", "parameters/ptv.par"), ("camera", "cal/cam1.tif.ori"))),
        Reader("OpenCV YAML", "a.yml", lambda p: formats.load(p, "opencv"), (opencv,), TREE),
        Reader("OpenCV JSON", "a.json", lambda p: formats.load(p, "opencv"), (as_json,), TREE),
        Reader("OpenCV stereo", "intrinsics.yml", stereo, (intrinsics,), TREE,
               {"extrinsics.yml": extrinsics}),
        Reader("MyPTV", "cam1", lambda p: formats.load(p, "myptv"), (seeds.myptv(),), TEXT),
        Reader("format unknown", "rig.json", _of_any_name, anything, TREE,
               links=_ENDINGS),
    ]  # fmt: skip


_ENDINGS = ("rig.toml", "rig.yaml", "rig.txt")


def _of_any_name(path: Path) -> object:
    """Read a file whose format is to be told, under each of the endings that decide."""
    from rigs import formats

    for name in _ENDINGS:
        try:
            formats.sniff(path.with_name(name))
        except ValueError as error:
            if "\n" in str(error):
                raise
    return formats.load(path)


def _scans(folder: Path) -> list[Reader]:
    from rigs import formats
    from rigs.file import save_rig
    from tomo import Scan, VoxelGrid
    from tomo.io import write_volume

    rig = seeds.rig("none")
    grid = VoxelGrid((2, 3, 4), 0.5)
    write_volume(folder / "truth.npz", np.ones((2, 3, 4), np.float32), grid)
    image = binary.tiff_seeds()[2]
    formats.save(rig, folder / "transforms.json")
    transforms = (folder / "transforms.json").read_bytes()
    beside = {
        "rig.yaml": seeds.written(lambda path: save_rig(rig, path), folder, "rig1.yaml"),
        "a.tif": image,
        "images/cam0.tif": image,
        "truth.npz": (folder / "truth.npz").read_bytes(),
    }

    def load(path: Path) -> object:
        scan = Scan.load(path)
        return scan.read()

    return [
        Reader("scan.yaml", "scan.yaml", load, (seeds.scan_yaml(),), TREE, beside),
        Reader("scan of transforms.json", "transforms.json", load,
               (transforms.replace(b".png", b".tif"),), TREE, beside),
    ]  # fmt: skip


def _volumes(folder: Path) -> list[Reader]:
    from tomo import VoxelGrid
    from tomo.io import read_volume, write_volume

    grid, data = VoxelGrid((2, 3, 4), 0.5), np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    own = {}
    for suffix in (".npz", ".vti", ".nrrd"):
        write_volume(folder / f"v{suffix}", data, grid)
        own[suffix] = (folder / f"v{suffix}").read_bytes()
    return [
        Reader("volume .npz", "v.npz", read_volume, binary.npz_seeds(folder / "v.npz", "volume"),
               (change_zip, change_zip, change_zip, *BINARY)),
        Reader("volume .vti", "v.vti", read_volume, binary.vti_seeds(own[".vti"]),
               (*TEXT, *BINARY)),
        Reader("volume .nrrd", "v.nrrd", read_volume, binary.nrrd_seeds(own[".nrrd"]),
               (*TEXT, *BINARY)),
    ]  # fmt: skip


def _images(folder: Path) -> list[Reader]:
    from rigs.calibrate import _detection_cache
    from rigs.calibrate._found import Found
    from rigs.calibrate.image_sets import read_source
    from tomo.io import is_integer_image, read_image
    from tomo.io._lzw import unpacked_length

    unpacked_length(np.frombuffer(b"\x80\x40", np.uint8))  # compiled before it is watched
    found = Found(np.arange(3), np.ones((3, 2)), 1.0, "", None)
    nothing = Found.nothing("too dark")
    _detection_cache.write(folder / "cache", {"a": (found, (9, 7)), "b": (nothing, (9, 7))})

    def image(path: Path) -> object:
        read_image(path, 12)
        return is_integer_image(path)

    return [
        Reader("image .tif", "a.tif", image, binary.tiff_seeds(), BINARY),
        Reader("image .png", "a.png", read_image, binary.png_seeds(),
               (change_png, change_png, *BINARY)),
        Reader("calibration image", "a.tif", read_source,
               (*binary.other_images(), *binary.png_seeds(), *binary.tiff_seeds()),
               (*BINARY, change_png, *TEXT[:2])),
        Reader("detection cache", "found.npz", _detection_cache.read,
               binary.npz_seeds(folder / "cache", "cache"), (change_zip, change_zip, *BINARY)),
    ]  # fmt: skip


def _learned(folder: Path) -> list[Reader]:
    import torch

    from tomo.solve.stopping import Choice
    from tomo.wernet._checkpoint import Checkpoint, Learned, State
    from tomo.wernet.correction import CorrectionEncoder, ViewTokens
    from tomo.wernet.encoder import WeightEncoder
    from tomo.wernet.encoder_file import load_encoder, save_encoder
    from tomo.wernet.ray_weights import RayWeights

    files, path = [], folder / "a.pt"
    for encoder in (
        WeightEncoder("batch-norm", blocks=1, channels=2),
        WeightEncoder("bias-mask", blocks=2, channels=2),
        CorrectionEncoder(blocks=1, channels=2),
    ):
        save_encoder(encoder, path)
        files.append(path.read_bytes())
    content = torch.load(path, weights_only=True)
    for trick in binary.tensor_tricks(content):
        file = io.BytesIO()
        torch.save(trick, file)
        files.append(file.getvalue())
    legacy = io.BytesIO()
    torch.save(content, legacy, _use_new_zipfile_serialization=False)
    files.append(legacy.getvalue())

    encoder, tokens = CorrectionEncoder(blocks=1, channels=2), ViewTokens(2, 2)
    volume = np.ones((2, 2, 2), np.float32)
    weights = RayWeights(encoder, tokens, np.ones(8, np.float32), 1.0, True)
    best = Learned(1, 0.1, 0.1, volume, {"iterations": 3}, weights)
    optimiser = torch.optim.Adam(encoder.parameters())
    training = {
        "encoder": encoder.state_dict(),
        "tokens": tokens.state_dict(),
        "optimiser": optimiser.state_dict(),
        "generator": torch.Generator().manual_seed(0).get_state(),
    }
    choice = Choice("mlem", 0.0, 10, 0.1)
    checkpoint = Checkpoint(path, "a problem")
    states = []
    for learned in (best, None):
        checkpoint.save(State(2, volume, choice, learned, 0.5, "", training))
        states.append(path.read_bytes())

    def resume(file: Path) -> object:
        return Checkpoint(file, "a problem").load()

    pickled = (change_zip, change_zip, change_zip, *BINARY)
    return [
        Reader("encoder", "a.pt", load_encoder, binary.torch_seeds(files), pickled),
        Reader("checkpoint", "c.pt", resume, binary.torch_seeds(states), pickled),
    ]


_MADE_BY: dict[Callable[[Path], list[Reader]], tuple[str, ...]] = {
    _rigs: (
        *("rig.yaml", "ray table", "Middlebury", "COLMAP cameras", "COLMAP images"),
        *("COLMAP rigs", "transforms.json", "multical", "Kalibr", "anipose", "OpenPTV project"),
        *("OpenPTV camera", "OpenCV YAML", "OpenCV JSON", "OpenCV stereo", "MyPTV"),
        "format unknown",
    ),
    _scans: ("scan.yaml", "scan of transforms.json"),
    _volumes: ("volume .npz", "volume .vti", "volume .nrrd"),
    _images: ("image .tif", "image .png", "calibration image", "detection cache"),
    _learned: ("encoder", "checkpoint"),
}

NAMES = tuple(name for names in _MADE_BY.values() for name in names)
"""Of the readers, in the order of the table."""

OFTEN = ("rig.yaml", "transforms.json", "format unknown", "scan.yaml", "volume .vti")
OFTEN += ("volume .nrrd", "image .tif")
"""The readers of files with the most in them: they get twice the inputs."""
