"""The faces of solids as rows of one table, which the compiled tracer reads.

A face knows the medium on both of its sides. Its front is the side that its normal points to: the
outside of a cylinder or a sphere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.scene.materials import Glass, Material, Opaque, Reflecting

PLANE, CYLINDER, SPHERE, TRIANGLE = range(4)
BLOCKS, REFLECTS, REFRACTS = range(3)

FACE = np.dtype(
    [
        ("kind", np.int64),
        ("action", np.int64),
        ("solid", np.int64),
        ("point", np.float64, (3,)),  # on the plane, on the axis, or the centre
        ("axis", np.float64, (3,)),  # the plane's normal or the cylinder's axis
        ("across", np.float64, (3,)),  # along the first side of a rectangle
        ("upward", np.float64, (3,)),  # along the second
        ("radius", np.float64),  # of the disc, the cylinder or the sphere
        ("hole", np.float64),  # radius of the hole in a disc
        ("half", np.float64, (2,)),  # half the sides of a rectangle; half a cylinder's length
        ("index", np.float64, (2,)),  # refractive index in front and behind
        ("extinction", np.float64, (2,)),  # in front and behind, 1 / length
        ("reflectivity", np.float64),
    ]
)
"""A face; lengths in the rig's unit. One row of kind TRIANGLE stands for a whole mesh."""


def face(
    kind: int,
    material: Material,
    point: ArrayLike,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    *,
    radius: float = np.inf,
    hole: float = 0.0,
    across: ArrayLike | None = None,
    half: tuple[float, float] = (np.inf, np.inf),
    front: tuple[float, float] = (1.0, 0.0),
    behind: tuple[float, float] | None = None,
) -> NDArray:
    """Return a row of the table, ``(1,)`` of `FACE`.

    Parameters
    ----------
    kind : {PLANE, CYLINDER, SPHERE}
    material : Material
        It says what happens to light that meets the face.
    point, axis, radius, hole, across, half
        As in `FACE`; ``axis`` is a unit vector.
    front, behind : (float, float)
        Index and extinction on each side; by default those of the glass behind it.
    """
    row = np.zeros(1, FACE)
    row["kind"], row["point"], row["axis"] = kind, point, axis
    row["radius"], row["hole"], row["half"] = radius, hole, half
    row["across"] = perpendicular(np.asarray(axis, float)) if across is None else across
    row["upward"] = np.cross(row["axis"], row["across"])
    if behind is None:
        behind = (material.index, material.extinction) if isinstance(material, Glass) else front
    row["index"] = front[0], behind[0]
    row["extinction"] = front[1], behind[1]
    row["action"] = {Opaque: BLOCKS, Reflecting: REFLECTS, Glass: REFRACTS}[type(material)]
    row["reflectivity"] = material.reflectivity if isinstance(material, Reflecting) else 1.0
    return row


def perpendicular(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a unit vector across ``axis``, ``(3,)``."""
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    return across / np.linalg.norm(across)
