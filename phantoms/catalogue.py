"""Phantoms by name, for commands and studies."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from phantoms.blobs import GaussianBlobs, RandomHomogeneous
from phantoms.field import REFERENCE_EXTENT, Field
from phantoms.flames import JetFlame, Plume, TurbulentFlame

_CATALOGUE: dict[str, Callable[..., Field]] = {
    "blobs": GaussianBlobs.random,
    "homogeneous": RandomHomogeneous,
    "jet": JetFlame,
    "plume": Plume,
    "turbulent": TurbulentFlame,
}


def names() -> tuple[str, ...]:
    """Return the names that :func:`create` knows, sorted."""
    return tuple(sorted(_CATALOGUE))


def create(
    name: str,
    seed: int = 0,
    extent: ArrayLike = REFERENCE_EXTENT,
    center: ArrayLike = (0.0, 0.0, 0.0),
) -> Field:
    """Return the phantom called ``name``, made for the box of ``extent`` around ``center``.

    Parameters
    ----------
    name : str
        One of :func:`names`.
    seed : int
        Selects the member of the family; equal seeds give bit-identical fields.
    extent, center : (float, float, float)
        The box in world units, with the flame's axis along y; the paper's box by default.

    Raises
    ------
    ValueError
        If there is no such phantom, or the box or seed is out of range.

    Examples
    --------
    >>> create("jet", seed=3)
    JetFlame(seed=3, extent=(15.0, 70.0, 15.0), center=(0.0, 0.0, 0.0), time=0.0)
    """
    if name not in _CATALOGUE:
        raise ValueError(f"phantom: found {name!r}, expected one of {', '.join(names())}")
    return _CATALOGUE[name](seed=seed, extent=extent, center=center)
