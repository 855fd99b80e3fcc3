"""All formats: recognised by content, read into a Rig, written from one."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from rigs.files.units import in_unit
from rigs.formats._file_storage import is_storage
from rigs.formats._values import errors_of_file, read_head
from rigs.recordings import IMAGE_SUFFIXES
from rigs.rig import Rig


@dataclass(frozen=True)
class Format:
    """A file format and its module here, or that of ``base``, where a name alone chooses it.

    A module has ``looks_like(path, head)``, ``load(path, image_size)``, which takes ``options``
    too, and, where it writes, ``save(rig, path)``. Its errors are lines of ValueError that begin
    with the camera and field; `load` and `save` here put the file before them. Paths with
    ``suffixes`` are written in it by default. Every file of it holds ``words``: errors name the
    format that lacks fewest of them.
    """

    name: str
    about: str
    suffixes: tuple[str, ...] = ()
    reads: bool = True
    writes: bool = False
    base: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""

    @property
    def module(self) -> ModuleType:
        """The module that reads and writes it."""
        return importlib.import_module(f"rigs.formats.{self.base or self.name}")

    def looks_like(self, path: Path, head: str) -> bool:
        """Return whether a path is of this format, by a file's first characters."""
        return not self.base and self.module.looks_like(path, head)


#: In the order in which files are tried.
FORMATS: dict[str, Format] = {
    item.name: item
    for item in (
        Format("emission_rig", "our rig.yaml", (".yaml",), writes=True),
        Format("middlebury", "Middlebury multi-view *_par.txt"),
        Format("colmap", "COLMAP model, text or binary, a folder", ("cameras.txt",), writes=True),
        Format("transforms", "NeRF-style transforms.json", ("transforms.json",), writes=True),
        Format("multical", "multical's calibration.json",
               words="cameras camera_poses model image_size dist"),
        Format("kalibr", "Kalibr's camchain.yaml",
               words="cam0 camera_model intrinsics distortion_model resolution"),
        Format("anipose", "TOML of anipose, Pose2Sim, FreeMoCap, caliscope",
               words="size matrix distortions rotation translation"),
        Format("openptv", "OpenPTV .ori and .addpar, of a folder or one"),
        Format("easymocap", "EasyMocap's intri.yml and extri.yml"),
        Format("mrcal", "mrcal's .cameramodel with OpenCV's lenses",
               words="lensmodel extrinsics intrinsics imagersize"),
        Format("metashape", "Agisoft Metashape's cameras.xml",
               words="document chunk sensors cameras camera"),
        Format("gaussian_splatting", "3-D Gaussian splatting's cameras.json",
               words="img_name width height position rotation fx fy"),
        Format("alicevision", "Meshroom's and AliceVision's .sfm",
               words="version views intrinsics poses viewId intrinsicId"),
        Format("opensfm", "OpenSfM's and ODM's reconstruction.json",
               words="cameras projection_type shots rotation translation"),
        Format("qualisys", "Qualisys Track Manager's .qca.txt",
               words="calibration cameras fov_video transform focalLengthU"),
        Format("kitti", "KITTI's calib_cam_to_cam.txt and calib.txt",
               words="S_00 K_00 D_00 R_00 T_00"),
        Format("camera_table", "a table (CSV): where cameras stand and look",
               words="name x y z look_x look_y look_z"),
        Format("realitycapture", "RealityCapture's camera parameters, .csv",
               words="name x y alt heading pitch roll f"),
        Format("pix4d", "Pix4D's *_calibrated_camera_parameters.txt",
               words="fileName imageWidth imageHeight camera matrix K radial"),
        Format("opencv", "cv2.FileStorage YAML, XML, JSON", (".yml", ".json"), writes=True),
        Format("myptv", "MyPTV's camera files"),
        Format("bundler", "Bundler's bundle.out with its list.txt"),
        Format("projection", "3 x 4 projection matrices, a file each (PMVS, DTU)"),
        Format("dlt", "DLT coefficients, pixels from 0 at the top left"),
        Format("dlt_matlab", "DLT of DLTdv8, easyWand: from 1 at the top left", base="dlt",
               options={"first": 1, "bottom": False}),
        Format("dlt_bottom", "DLT of Argus, DLTdv 3 to 7: from 1 at the bottom left", base="dlt",
               options={"first": 1, "bottom": True}),
        Format("astra", "ASTRA cone_vec as JSON", (".astra.json",), reads=False, writes=True),
        Format("rtk", "RTK circular geometry XML", (".xml",), reads=False, writes=True),
    )
}  # fmt: skip

#: A key of rig.yaml, and any key: YAML with the first, or without the second, is meant as ours.
_OUR_KEY = re.compile(
    r"^(format|version|cameras|length_unit|convention|world_frame|volume)\s*:", re.MULTILINE
)
_ANY_KEY = re.compile(r"^[\w.-]{1,40}\s*:", re.MULTILINE)


def names(writable: bool = False) -> tuple[str, ...]:
    """Return the names of the formats that can be read, or of those that can be written."""
    return tuple(
        name for name, item in FORMATS.items() if (item.writes if writable else item.reads)
    )


def sniff(path: str | os.PathLike) -> str:
    """Return the name of the format of the file or folder at ``path``.

    Raises
    ------
    FileNotFoundError
        If there is no such path.
    ValueError
        If it is in none of the formats, in one line that names those known.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    found = _recognised(path, names())
    if found:
        return found[1]
    head = read_head(path) if path.is_file() else ""
    if is_storage(head):
        return "opencv"  # its error names the keys found
    is_ours = _OUR_KEY.search(head) or not _ANY_KEY.search(head)
    if path.suffix in (".yaml", ".yml") and is_ours:
        return "emission_rig"  # its error names what a rig.yaml lacks
    what = "an image" if path.suffix.lower() in IMAGE_SUFFIXES else "none of the rig formats"
    raise ValueError(
        f"{path}: found {what}, expected a file or folder of a calibration, in one of "
        f"{', '.join(names())}{_nearest(head)}"
    )


def _nearest(head: str) -> str:
    """Return the end of a message: the format with most of its words in a file, and the others."""
    found = set(re.findall(r"\w+", head))
    lost = {
        n: [w for w in f.words.split() if w not in found] for n, f in FORMATS.items() if f.words
    }
    share = {name: 1 - len(own) / len(FORMATS[name].words.split()) for name, own in lost.items()}
    best = max(share, key=lambda name: share[name])
    if share[best] < 1 / 2:  # with less than half, any file is like some format
        return ""
    lacks = f"lacks {', '.join(lost[best])}" if lost[best] else f"try --from {best}"
    return f"; nearest is {best} ({FORMATS[best].about}): {lacks}"


def _recognised(path: Path, choices: tuple[str, ...]) -> tuple[Path, str] | None:
    """Return what to read and its format: a path, or the one known file of a folder."""
    found = _format_of(path, choices)
    if found or not path.is_dir():
        return (path, found) if found else None
    known = _rig_files(path, choices)
    if len(known) > 1:
        listed = ", ".join(f"{file.name} ({name})" for file, name in known[:6])
        raise ValueError(f"{path}: found {len(known)} rigs, {listed}, expected one of them as IN")
    return known[0] if known else None


def rigs_in(folder: str | os.PathLike) -> list[tuple[Path, str]]:
    """Return the rigs in a folder and their formats: files, or the folder for several of one."""
    folder = Path(folder)
    form, files = _format_of(folder, names()), _rig_files(folder, names())
    if form is None or sum(one == form for _, one in files) == 1:
        return files
    return [(folder, form), *((path, one) for path, one in files if one != form)]


def _rig_files(folder: Path, choices: tuple[str, ...]) -> list[tuple[Path, str]]:
    """Return the files of a folder that are rigs, and their formats."""
    files = [
        file
        for file in sorted(folder.iterdir())
        if file.is_file() and file.suffix.lower() not in IMAGE_SUFFIXES
    ]
    # a rig's folder has few files; to look into thousands, a frame each, would take seconds
    return [(file, name) for file in files[:100] if (name := _format_of(file, choices))]


def _format_of(path: Path, choices: tuple[str, ...]) -> str | None:
    """Return the first format that takes a path for its own."""
    head = read_head(path) if path.is_file() else ""
    return next((n for n in choices if FORMATS[n].looks_like(path, head)), None)


def load(
    path: str | os.PathLike,
    format: str | None = None,
    *,
    length_unit: str | None = None,
    image_size: tuple[int, int] | None = None,
) -> Rig:
    """Return the rig in a file, or a folder, of any format.

    Parameters
    ----------
    path : path
    format : str, optional
        One of `names`; by default it is recognised by the content.
    length_unit : str, optional
        Unit of the rig returned. Lengths are converted where the format names their unit, else
        they are taken to be in it.
    image_size : (int, int), optional
        Width and height in pixels, for formats that hold none.

    Raises
    ------
    FileNotFoundError, IsADirectoryError, ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    name = _known(format, names(), "read").name if format else sniff(path)
    path, _ = (_recognised(path, (name,)) if path.is_dir() else None) or (path, name)
    try:
        with errors_of_file(path):
            rig = FORMATS[name].module.load(path, image_size, **FORMATS[name].options)
    except ArithmeticError as error:  # whatever a format computes of numbers that are far off
        reason = " ".join(str(error.args[-1] if error.args else error).split())
        raise ValueError(f"{path}: found numbers that no camera has: {reason}") from None
    with errors_of_file(path):
        for camera in rig:
            if image_size is not None and camera.image_size != tuple(image_size):
                raise ValueError(
                    f"camera {camera.name}: image_size: found {tuple(image_size)}, "
                    f"expected {camera.image_size} as in the file"
                )
        return rig if length_unit is None else in_unit(rig, length_unit)


def save(rig: Rig, path: str | os.PathLike, format: str | None = None) -> None:
    """Write ``rig`` in a foreign format.

    Parameters
    ----------
    rig : Rig
    path : path
        A file, or a folder for formats of several files.
    format : str, optional
        One of ``names(writable=True)``; by default it follows from the ending of ``path``.

    Raises
    ------
    ValueError
        Naming camera and field, where the format cannot hold what the rig holds.
    """
    path = Path(path)
    item = _known(format, names(writable=True), "written") if format else _by_name(path)
    with errors_of_file(path):
        item.module.save(rig, path)


def _known(name: str, choices: tuple[str, ...], verb: str) -> Format:
    """Return the format called ``name``."""
    if name not in choices:
        raise ValueError(f"format: found {name!r}, expected one {verb}: {', '.join(choices)}")
    return FORMATS[name]


def _by_name(path: Path) -> Format:
    """Return the format that files named like ``path`` are written in."""
    fitting = [
        (len(suffix), item)
        for item in FORMATS.values()
        if item.writes
        for suffix in item.suffixes
        if path.name.endswith(suffix)
    ]
    if fitting:
        return max(fitting, key=lambda pair: pair[0])[1]
    raise ValueError(
        f"{path}: its ending names no format, expected --to with one of "
        f"{', '.join(names(writable=True))}"
    )
