"""Cameras of OpenPTV behind a flat window: rays bent twice, by Snell's law.

The window's inner face is the plane ``n . X = |G|``, with G the ``.ori``'s glass vector from the
world's origin and n its direction; its outer face lies d further towards the camera. A direction's
part across n is multiplied by n1 / n2 at the outer face and n2 / n3 at the inner one; behind it
rays are straight again. Source: ``liboptv/src/ray_tracing.c`` at https://github.com/OpenPTV/openptv.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import CameraLike
from rigs.formats._image_size import check_table_size
from rigs.geometry.image_checks import pixel_centres
from rigs.ray_table import RayTable


@dataclass(frozen=True)
class Media:
    """Refraction indices before, in and behind a window, and its thickness in mm.

    Examples
    --------
    >>> Media(1.0, 1.46, 1.33, 6.0).bends
    True
    """

    n1: float
    n2: float
    n3: float
    d: float

    def __post_init__(self) -> None:
        """Check the numbers."""
        indices = [self.n1, self.n2, self.n3]
        if not min(indices) > 0:
            raise ValueError(f"n1, n2, n3: found {indices}, expected positive refraction indices")
        if not self.d >= 0:
            raise ValueError(f"d: found {self.d}, expected a thickness >= 0")

    @property
    def bends(self) -> bool:
        """Whether rays change their direction."""
        return not self.n1 == self.n2 == self.n3


def behind_glass(camera: CameraLike, glass: NDArray[np.float64], media: Media) -> RayTable:
    """Return the camera whose rays pass a window: a table of the rays behind it.

    Parameters
    ----------
    camera : CameraLike
        In the first medium.
    glass : (3,) float64
        From the world's origin to the window's inner face, in mm.
    media : Media

    Raises
    ------
    ValueError
        If there is no such window, or the camera does not stand before it.
    """
    distance = float(np.linalg.norm(glass))
    if not 0 < distance < np.inf:
        raise ValueError(
            f"glass_x, glass_y, glass_z: found {glass.tolist()}, expected a vector to the glass"
        )
    check_table_size(camera.image_size)
    normal = glass / distance
    origins, directions = camera.rays(pixel_centres(camera.image_size))
    height = origins[0] @ normal - distance - media.d
    if not height > 0:
        raise ValueError(
            f"glass_x, glass_y, glass_z: found {glass.tolist()}, a window {-height:.6g} mm behind "
            "the camera, expected one before it"
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = np.where(directions @ normal < 0, -(directions @ normal), np.nan)[:, None]
        outer = origins + directions * (height / towards)
        inside = _bent(directions, normal, media.n1 / media.n2)
        inner = outer + inside * (media.d / -(inside @ normal))[:, None]
        seen = _bent(inside, normal, media.n2 / media.n3)
    lost = ~np.isfinite(inner + seen).all(axis=1)
    inner[lost], seen[lost] = 0.0, np.nan
    shape = (*camera.image_size[::-1], 3)
    rows = inner.reshape(shape), seen.reshape(shape)
    return RayTable(camera.name, *rows, status="calibrated")


def _bent(
    directions: NDArray[np.float64], normal: NDArray[np.float64], ratio: float
) -> NDArray[np.float64]:
    """Return unit directions ``(N, 3)`` behind a face, against its normal; NaN if reflected."""
    across = ratio * (directions - (directions @ normal)[:, None] * normal)
    return across - np.sqrt(1 - np.sum(across**2, axis=1, keepdims=True)) * normal
