"""Every reader there is, with the files it starts from and how they are changed."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from _stress import fuzzing_files as binary
from _stress import fuzzing_seeds as seeds
from _stress.fuzzing_containers import change_png, change_zip
from _stress.fuzzing_mutations import BINARY, TEXT, TREE
from _stress.fuzzing_reader import Reader
from _stress.fuzzing_rig_readers import rig_readers


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


def _scans(folder: Path) -> list[Reader]:
    from rigs import formats
    from rigs.files import save_rig
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
    from rigs.calibrate.detect import _detection_cache
    from rigs.calibrate.detect.found import Found
    from rigs.calibrate.detect.image_sets import read_source
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

    from tomo.selection import Choice
    from tomo.wernet import load_encoder, save_encoder
    from tomo.wernet.default import CorrectionEncoder, RayWeights, ViewTokens
    from tomo.wernet.default.checkpoint import Checkpoint, Learned, State
    from tomo.wernet.paper import WeightEncoder

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
    rig_readers: (
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
