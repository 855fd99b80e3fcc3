"""Lens models of the programs that follow OpenCV, in and out of `Distortion`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rigs.camera_protocol import LensCamera, has_lens
from rigs.lens import Distortion
from rigs.rig import Rig

#: OpenCV's vector of coefficients, by its length.
_BY_LENGTH = {4: "brown", 5: "brown", 8: "rational", 12: "thin_prism", 14: "tilted"}


def from_vector(coefficients: ArrayLike, fisheye: bool, what: str) -> Distortion:
    """Return the lens of OpenCV's vector; where all are zero, and it is no fisheye, none."""
    values = np.asarray(coefficients, np.float64).reshape(-1)
    if fisheye:
        if len(values) != 4:
            raise ValueError(f"{what}: found {len(values)} coefficients, expected 4 of a fisheye")
        return Distortion("fisheye", tuple(values))
    if not values.any():
        return Distortion()
    if len(values) not in _BY_LENGTH:
        raise ValueError(
            f"{what}: found {len(values)} coefficients, "
            f"expected {', '.join(str(n) for n in _BY_LENGTH)}"
        )
    return Distortion(_BY_LENGTH[len(values)], tuple(values))


def refuse_tables(rig: Rig, format_name: str) -> list[LensCamera]:
    """Return the cameras, or raise if one is a table of rays or looks through a scene.

    Few formats hold those.
    """
    if rig.scene is not None:
        raise ValueError(
            f"scene: found {', '.join(solid.name for solid in rig.scene.solids) or 'none'}, which "
            f"{format_name} lacks: write a rig.yaml, with --ray-tables for programs that know no "
            "scene"
        )
    cameras: list[LensCamera] = []
    for camera in rig:
        if not has_lens(camera):
            raise ValueError(
                f"camera {camera.name}: ray_table: found a table of rays, "
                f"which {format_name} lacks"
            )
        cameras.append(camera)
    return cameras


def refuse_skew(camera: LensCamera, format_name: str) -> None:
    """Raise if the pixels' axes are skewed, which many formats cannot hold."""
    skew = float(camera.camera_matrix[0, 1])
    if skew != 0:
        raise ValueError(
            f"camera {camera.name}: camera_matrix: found skew {skew}, which {format_name} lacks"
        )


def refuse_lens(camera: LensCamera, format_name: str) -> None:
    """Raise because a format cannot hold a camera's lens."""
    raise ValueError(
        f"camera {camera.name}: distortion: found model {camera.distortion.model} "
        f"{list(camera.distortion.coefficients)}, which {format_name} lacks"
    )


def named_model(camera: LensCamera, format_name: str) -> tuple[str, dict[str, float]]:
    """Return the name that COLMAP and nerfstudio give a lens, and its coefficients by name.

    A model whose further coefficients are zero is written as the shorter one that is the same.
    """
    model, values = camera.distortion.model, camera.distortion.coefficients
    full = dict(zip(_NAMES, values, strict=False))  # of a fisheye: not used
    if model == "none":
        return "PINHOLE", {}
    if model == "fisheye":
        return "OPENCV_FISHEYE", dict(zip(("k1", "k2", "k3", "k4"), values, strict=True))
    if any(values[8:]):
        refuse_lens(camera, format_name)
    if model != "brown" and any(values[5:8]):
        return "FULL_OPENCV", {name: full[name] for name in _NAMES[:8]}
    return "OPENCV", {name: full.get(name, 0.0) for name in _NAMES[:5]}


_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
