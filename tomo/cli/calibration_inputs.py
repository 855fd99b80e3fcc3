"""Inputs of ``flametomo calibrate-rig``: images, world, volume, and what is known of lenses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomo.cli.inputs import Box, load_rig_or_preset

if TYPE_CHECKING:
    from rigs import Rig, Volume
    from rigs.calibrate.refraction import WindowPrior
    from rigs.scene import Scene


def given_scene(
    file: Path | None, refined: Iterable[str], length_unit: str
) -> tuple[Scene | None, list[WindowPrior]]:
    """Return the scene that the target was seen through, and its windows that are adjusted.

    Raises
    ------
    ValueError
        Naming the option.
    """
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
        option = (
            "" if file is not None and str(error).startswith(str(file)) else "--refine-window: "
        )
        raise ValueError(f"{option}{error}") from None
    return scene, windows


def given_lenses(texts: Iterable[str], cameras: Iterable[str]) -> Rig | None:
    """Return a rig that has a lens for each of ``cameras``, None where no rig is named.

    Parameters
    ----------
    texts : iterable of str
        A rig, and pairs ``A=B``: camera A has the lens of the rig's camera B.
    cameras : iterable of str

    Raises
    ------
    ValueError
        Naming the camera that has none, and those of the rig.
    """
    from rigs import Rig

    texts, cameras = list(texts), list(cameras)
    pairs = [text for text in texts if "=" in text and not Path(text).exists()]
    files = [text for text in texts if text not in pairs]
    if not texts:
        return None
    if len(files) != 1:
        raise ValueError(
            f"--intrinsics: found {len(files)} rigs ({', '.join(files) or 'none'}), expected one, "
            "and pairs A=B: camera A has the lens of the rig's camera B"
        )
    rig, source = load_rig_or_preset(files[0]), dict(zip(cameras, cameras, strict=True))
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
    return Rig(tuple(replace(rig[other], name=own) for own, other in source.items()))


def lens_sets(texts: Iterable[str], cameras: Iterable[str]) -> list[list[str]]:
    """Return the sets of cameras that ``--common-lens`` names; ``all`` is every camera."""
    cameras = list(cameras)
    return [
        cameras if text.strip() == "all" else [name.strip() for name in text.split(",")]
        for text in texts
    ]


def given_world(text: str | None) -> Any:
    """Return a name as it is, and the positions in a file."""
    if text is None or Path(text).suffix.lower() not in (".yaml", ".yml"):
        return text
    from rigs.files.text import read_yaml_mapping
    from rigs.geometry.rotation import numbers

    positions = read_yaml_mapping(text)
    return {name: numbers(point, (3,), f"{text}: {name}") for name, point in positions.items()}


def given_volume(box: Box) -> Volume | None:
    """Return the voxels that options describe; None where there are none."""
    from rigs import Volume

    if not box:
        return None
    voxels = box.voxels()
    return Volume(voxels.shape, voxels.spacing, voxels.center)


def are_mosaics(bayer: str | None) -> bool:
    """Return whether images are mosaics; an order of colours that is none is refused."""
    from rigs.recordings import Mosaic

    return bayer is not None and bool(Mosaic(bayer.upper(), "g"))
