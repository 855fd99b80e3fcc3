"""``flametomo calibrate-rig``: a rig from images of a flat target, and how accurate it is."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tomo.cli.console import print_json, say
from tomo.cli.inputs import Box, check_output_file, check_output_folder, load_rig_and_grid
from tomo.pipeline.declared import whole

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.calibrate.refraction import WindowPrior
    from rigs.scene import Scene

PAGE, FIGURES = "_calibration.html", "_calibration.json"
"""Endings of the two files beside a rig.yaml, whose name they begin with."""

EXAMPLES = """
flametomo calibrate-rig images --target chessboard:9x6:25
    -o rig.yaml
flametomo calibrate-rig poses --intrinsics-images lenses -o rig.yaml
    --target chessboard:9x6:25 --square-pixels --common-lens all
flametomo calibrate-rig images -o rig.yaml --grid 30x140x30
    --spacing 0.5 --target charuco:5x4:54:40.5:DICT_4X4_1000
"""


def calibrate_rig(
    images: Path,
    /,
    *,
    target: str,
    out: Path,
    length_unit: str = "mm",
    model: str = "auto",
    world: str | None = None,
    rescale: bool = False,
    report: Path | None = None,
    pattern: str | None = None,
    bayer: str | None = None,
    every: Annotated[int, whole(1)] = 1,
    cache: Path | None = None,
    json: bool = False,
    intrinsics: Sequence[str] | None = None,
    intrinsics_images: Path | None = None,
    square_pixels: bool = False,
    fixed_center: bool = False,
    common_lens: Sequence[str] | None = None,
    scene: Path | None = None,
    refine_window: Sequence[str] | None = None,
    box: Box,
) -> None:
    """Calibrate a rig from images of a flat target.

    The target was moved about in front of the cameras. Camera matrices, distortion, camera poses
    and target poses are adjusted together. A page and a JSON file with every figure are written
    next to the rig; the page begins with the assessment. The rig is checked in the voxels of a
    grid, which is stored in it.

    Parameters
    ----------
    images : IMAGES
        A folder with one folder of images, or one video, for each camera, or with images
        CAMERA_NUMBER.*. Images of the same name were taken at the same time.
    target : TARGET
        chessboard:9x6:25 (inner corners, square), circles:7x5:20, acircles:4x11:20 (spacing) or
        charuco:5x4:54:40.5:DICT_4X4_1000 (squares, square, marker, dictionary).
    out : FILE
        The rig.yaml to write.
    length_unit : UNIT
        Unit of the target's lengths and of the rig.
    model : MODEL
        Distortion model: none, radial, brown4, brown5, rational, thin_prism, tilted, fisheye, or
        auto, which adds terms that lower the error.
    world : NAME
        Origin and axes: a camera's name, a frame's name (the target in it), or a YAML file with
        the positions of three or more cameras by name. The first camera if absent.
    rescale :
        Take the scale from the positions in --world.
    report : FOLDER
        Folder for RIG_calibration.html and RIG_calibration.json; the rig's if absent.
    pattern : PATTERN
        How the images are named otherwise, like '{frame}/{camera}.png'.
    bayer : ORDER
        Images are mosaics of colour filters in this order, like RGGB: the target is searched in
        their brightness.
    every : N
        Use one picture of a video in this many.
    cache : FILE
        A file that stores the detections for the next run.

    Lenses
    ------
    intrinsics : RIG|A=B
        A rig whose lenses and camera matrices are kept; then, repeated, A=B where camera A is
        called B in it.
    intrinsics_images : FOLDER
        More images of the target, of each camera by itself, for its lens alone: a folder or video
        per camera as in IMAGES. Names of equal files mean nothing here.
    square_pixels :
        Pixels are square: fx = fy.
    fixed_center :
        The principal point is in the middle of the image.
    common_lens : A,B
        Cameras that share camera matrix and distortion, or all; repeatable.

    Windows, water, hardware
    ------------------------
    scene : FILE
        What the target was seen through: a YAML file with the scene of a rig.yaml, in the world
        of --world. It becomes part of the rig.
    refine_window : NAME:FIELD=SD
        Adjust a window of the scene too: standard deviations of its given normal (degrees),
        distance and thickness, like quartz:normal=1,thickness=0.2; repeatable.
    """
    started = time.perf_counter()
    _check_outputs(out, report, cache)
    from rigs import Volume, save_rig
    from rigs.calibrate import calibrate_rig as calibrate
    from rigs.calibrate import image_set, parse_target
    from rigs.calibrate.detect.image_sets import check_not_split
    from rigs.files.text import write_json
    from rigs.recordings import Mosaic
    from rigs.recordings.layout import cameras_and_frames
    from tomo.draw import write_calibration_page

    flat, voxels = parse_target(target), box.voxels() if box else None
    axes, strays = _world(world), list[str]()
    are_mosaics = bayer is not None and bool(Mosaic(bayer.upper(), "g"))
    naming = {"pattern": pattern, "are_mosaics": are_mosaics}
    if pattern is None:
        check_not_split(images, bool(intrinsics or intrinsics_images))
    found = image_set(images, every, strays.append, **naming)
    if pattern is not None:
        say(cameras_and_frames(found))
    cameras = list(found)
    optical, windows = _scene(scene, refine_window or [], length_unit)
    calibration = calibrate(
        found,
        flat,
        intrinsics=_lenses(intrinsics or [], cameras),
        intrinsics_images=intrinsics_images,
        common_lens=[
            cameras if text.strip() == "all" else [name.strip() for name in text.split(",")]
            for text in common_lens or []
        ],
        pattern=pattern,
        bayer=bayer,
        every=every,
        cache=cache,
        progress=True,
        world=axes,
        rescale=rescale,
        length_unit=length_unit,
        distortion=model,
        volume=voxels and Volume(voxels.shape, voxels.spacing, voxels.center),
        square_pixels=square_pixels,
        fixed_center=fixed_center,
        scene=optical,
        windows=windows,
    )
    calibration = replace(calibration, notes=(*strays, *calibration.notes))
    folder = out.parent if report is None else report
    page = folder / f"{out.stem}{PAGE}"
    seconds = time.perf_counter() - started
    figures = {"target": str(flat), "seconds": round(seconds, 3), **calibration.report()}
    out.parent.mkdir(parents=True, exist_ok=True)
    save_rig(calibration.rig, out)
    write_calibration_page(
        page,
        calibration,
        title=f"Calibration of {images.absolute().name}",
        details={"images": images, "target": flat, "time": f"{seconds:.0f} s"},
    )
    write_json(folder / f"{out.stem}{FIGURES}", figures, indent=2)
    for line in (calibration.assessment, *calibration.notes):
        say(line)
    if json:
        print_json({"rig": str(out), "page": str(page), **figures})


def _check_outputs(out: Path, report: Path | None, cache: Path | None) -> None:
    """Raise unless everything can be written: better now than after the work."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise ValueError(f"{out}: suffix: found {out.suffix!r}, expected .yaml")
    check_output_file(out)
    if cache is not None:
        check_output_file(cache)
    if report is not None:
        check_output_folder(report)


def _scene(
    file: Path | None, refined: Iterable[str], length_unit: str
) -> tuple[Scene | None, list[WindowPrior]]:
    """Return the scene that the target was seen through, and its windows that are adjusted."""
    from rigs.calibrate.refraction import Refraction, WindowPrior
    from rigs.files.rig_yaml import load_scene

    try:
        windows = [WindowPrior.parsed(text) for text in refined]
        if windows and file is None:
            raise ValueError("found windows to adjust, expected --scene FILE with them")
        scene = None if file is None else load_scene(file, length_unit)
        if scene is not None:
            Refraction.of(scene, windows)
    except ValueError as error:
        is_named = file is not None and str(error).startswith(str(file))
        raise ValueError(f"{'' if is_named else '--refine-window: '}{error}") from None
    return scene, windows


def _lenses(texts: Sequence[str], cameras: Sequence[str]) -> Rig | None:
    """Return a rig with a lens for each camera: that of the rig named, or by pairs ``A=B``."""
    pairs = [text for text in texts if "=" in text and not Path(text).exists()]
    files = [text for text in texts if text not in pairs]
    if not texts:
        return None
    if len(files) != 1:
        raise ValueError(
            f"--intrinsics: found {len(files)} rigs ({', '.join(files) or 'none'}), expected one, "
            "and pairs A=B: camera A has the lens of the rig's camera B"
        )
    rig, source = load_rig_and_grid(files[0])[0], dict(zip(cameras, cameras, strict=True))
    names, given = ", ".join(rig.names), set()
    for pair in pairs:
        own, _, other = pair.partition("=")
        if own not in source or own in given:
            raise ValueError(
                f"--intrinsics: {pair}: found {own!r}{' twice' if own in given else ''}, expected "
                f"a camera of the images once: {', '.join(cameras)}"
            )
        if other not in rig:
            raise ValueError(
                f"--intrinsics: {pair}: found {other!r}, expected a camera of {files[0]}: {names}"
            )
        given.add(own)
        source[own] = other
    for own, other in source.items():
        if other not in rig:
            raise ValueError(
                f"--intrinsics: camera {own}: not in {files[0]}, which has {names}; expected "
                f"its lens: add --intrinsics {own}={rig.names[0]}, or whichever camera it is"
            )
    cameras = tuple(rig[other].renamed(own) for own, other in source.items())
    return replace(rig, cameras=cameras)


def _world(text: str | None) -> Any:
    """Return a name as it is, and the positions in a file."""
    if text is None or Path(text).suffix.lower() not in (".yaml", ".yml"):
        return text
    from rigs.files.text import read_yaml_mapping
    from rigs.geometry.rotation import numbers

    positions = read_yaml_mapping(text)
    return {name: numbers(point, (3,), f"{text}: {name}") for name, point in positions.items()}
