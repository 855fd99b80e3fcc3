"""The readers of rigs, our own and foreign ones, with the files they start from."""

from __future__ import annotations

from pathlib import Path

from _stress import fuzzing_files as binary
from _stress import fuzzing_seeds as seeds
from _stress.fuzzing_containers import change_zip
from _stress.fuzzing_mutations import BINARY, TEXT, TREE
from _stress.fuzzing_reader import Reader

MOST_RAYS = 1 << 14
"""Pixels of the largest table of rays that a reader makes here; `rigs` allows 2^24."""


def rig_readers(folder: Path) -> list[Reader]:
    """Make them; ``folder`` is for the files that the writers write."""
    from rigs import RayTable, formats
    from rigs.files import load_rig, save_rig
    from rigs.formats import _image_size
    from rigs.ray_table.ray_file import load_ray_table, save_ray_table

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
