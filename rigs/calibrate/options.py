"""Checks of the options of `calibrate` that need names alone, before any image is read."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from numpy.typing import ArrayLike

from rigs.calibrate.adjust.lens_choice import TERMS
from rigs.rig import Rig
from rigs.scene.scene_camera import own_camera


def check_options(
    cameras: Collection[str],
    frames: Collection[str],
    *,
    intrinsics: Rig | None,
    world: str | Mapping[str, ArrayLike] | None,
    rescale: bool,
    length_unit: str,
    distortion: str,
    target: object | None,
    scene: object | None = None,
) -> None:
    """Raise unless the options of `rigs.calibrate.calibrate` suit such cameras and frames."""
    if distortion != "auto" and distortion not in TERMS:
        raise ValueError(
            f"distortion: found {distortion!r}, expected one of auto, {', '.join(TERMS)}"
        )
    if not isinstance(length_unit, str) or not length_unit.strip():
        raise ValueError(f"length_unit: found {length_unit!r}, expected a unit, like mm")
    ambiguity = getattr(target, "ambiguity", None)
    if ambiguity and len(cameras) > 1:
        raise ValueError(
            f"target: its pose is ambiguous ({ambiguity}), expected one that looks the same from "
            "one side only, to find where cameras stand"
        )
    if intrinsics is not None:
        for name in cameras:
            if name not in intrinsics:
                raise ValueError(f"intrinsics: camera {name}: not in the rig, expected its lens")
            if not own_camera(intrinsics[name]).has_lens_model:
                raise ValueError(f"intrinsics: camera {name}: found a ray table, expected a lens")
    if rescale and scene is not None:
        raise ValueError("rescale: found True with a scene, expected scene and target in one unit")
    if rescale and not isinstance(world, Mapping):
        raise ValueError("rescale: found True, expected world to give positions to scale by")
    for name in [world] if isinstance(world, str) else world or ():
        if name not in cameras and name not in frames:
            raise ValueError(
                f"world: found {name!r}, expected the name of a camera or of a frame; cameras are "
                f"{', '.join(cameras)}"
            )
    if isinstance(world, Mapping) and len(world) < 3:
        raise ValueError(f"world: found {len(world)} positions, expected 3 or more not on a line")


def check_lens_options(intrinsics: Rig | None, known: Mapping[str, object]) -> None:
    """Raise where lenses that are kept as they are come with what is to find them."""
    also = [name for name, given in known.items() if given]
    if intrinsics is not None and also:
        raise ValueError(
            f"intrinsics: found {', '.join(also)} too, expected none of them with lenses that are "
            "kept as they are"
        )


def common_lenses(
    cameras: Collection[str], sets: Iterable[Collection[str]]
) -> tuple[int, ...] | None:
    """Return for each camera the first one of its set, of two or more; None without sets."""
    names, first = list(cameras), list(range(len(cameras)))
    taken: set[str] = set()
    for one in sets:
        for name in one:
            if name not in names:
                raise ValueError(f"common_lens: found {name!r}, expected among {', '.join(names)}")
            if name in taken:
                raise ValueError(f"common_lens: found camera {name} twice, expected once")
            taken.add(name)
        if len(one) < 2:
            raise ValueError(
                f"common_lens: found {', '.join(one) or 'no camera'} alone, expected two or more "
                "cameras that share a lens"
            )
        places = [names.index(name) for name in one]
        for place in places:
            first[place] = min(places)
    return tuple(first) if taken else None


def check_common_sizes(
    common: tuple[int, ...] | None,
    image_sizes: tuple[tuple[int, int], ...],
    cameras: tuple[str, ...],
) -> None:
    """Raise where cameras that share a lens have images of different sizes."""
    for camera, first in enumerate(common or ()):
        if image_sizes[camera] != image_sizes[first]:
            sizes = ["{}x{}".format(*image_sizes[k]) for k in (camera, first)]
            raise ValueError(
                f"common_lens: camera {cameras[camera]}: found images of {sizes[0]} pixels, "
                f"expected {sizes[1]} as camera {cameras[first]} has"
            )
