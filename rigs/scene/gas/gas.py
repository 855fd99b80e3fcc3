"""Gas of a scene: an index that bends light, an extinction that takes it; both in files."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import path_inside, read_arrays
from rigs.files.text import write_bytes
from rigs.geometry.points import ALONG, box_points
from rigs.scene.gas.extinction_volume import ExtinctionVolume
from rigs.scene.gas.index_field import IndexField
from rigs.scene.gas.index_volume import IndexVolume

if TYPE_CHECKING:
    from rigs.scene.solids import Solid


@dataclass(frozen=True)
class Gas:
    """Gas in the light's way.

    Attributes
    ----------
    index : IndexField, optional
        None: gas that does not bend light.
    extinction : ExtinctionVolume, optional
        None: gas that does not absorb.

    Examples
    --------
    >>> Gas(extinction=ExtinctionVolume(np.full((1, 1, 1), 0.02), (-20, -20, 0), (40, 40, 90)))
    Gas(index=None, extinction=<ExtinctionVolume: 1x1x1 voxels, up to 0.02>)
    """

    index: IndexField | None = None
    extinction: ExtinctionVolume | None = None

    def __bool__(self) -> bool:
        """Whether there is any gas."""
        return self.index is not None or self.extinction is not None

    def check(self, solids: Iterable[Solid], medium: float = 1.0) -> None:
        """Raise if the gas does not fit the scene that it is in, of refractive index ``medium``.

        The index is the scene's at the box's faces, and no solid reaches into the box: rays in it
        are followed through gas alone.
        """
        if self.index is None:
            return
        own = getattr(self.index, "medium", medium)
        if abs(own - medium) > 1e-12:
            raise ValueError(
                f"gas: index: found {own:.6g} at its faces in a medium of {medium:.6g}, expected "
                "one index"
            )
        low, high = self.index.lower, self.index.upper
        for solid in solids:
            if reaches_into(solid, low, high):
                found = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
                raise ValueError(
                    f"gas: solid {solid.name}: reaches into the box of the refractive index, "
                    f"x, y, z from {found}, expected solids outside: make the box smaller"
                )

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the gas after the rigid motion ``x_new = R @ x_old + t`` of the world."""
        return replace(
            self,
            index=self.index and self.index.transformed(R, t),
            extinction=self.extinction and self.extinction.transformed(R, t),
        )

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the gas of a world whose lengths are ``factor`` times as large."""
        return replace(
            self,
            index=self.index and self.index.with_lengths_scaled(factor),
            extinction=self.extinction and self.extinction.with_lengths_scaled(factor),
        )


def reaches_into(solid: Solid, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Return whether a solid has points in a box, or points of the box are in the solid."""
    points = solid.samples()
    inside = ((points > low) & (points < high)).all(axis=1)
    return bool(inside.any() or solid.contains(box_points(low, high, ALONG)).any())


FINE = 1e-3
"""Step of the stored numbers over the range of the index, at most: coarser ones are stairs, whose
edges bend light more than the gas does."""

_KEYS = ("data", "origin", "spacing")


def read_gas(
    folder: str | os.PathLike,
    length_unit: str,
    *,
    index: str | None = None,
    extinction: str | None = None,
    medium: float = 1.0,
) -> Gas:
    """Return the gas that ``scene: gas:`` of a rig.yaml names, in a medium of that index.

    ``index, extinction`` name files of `read_voxels` relative to the rig's folder, which they may
    not leave: ``n``, and ``k`` in 1 / length. Errors name the field and the file.
    """
    found: dict[str, Any] = {}
    for name, file in (("index", index), ("extinction", extinction)):
        if file is None:
            continue
        where = f"gas: {name}"
        path = path_inside(file, Path(folder), where)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file, which scene: {where} names")
        try:
            values, lower, spacing = read_voxels(path, length_unit)
            if name == "index":
                _check_steps(values)
                found[name] = IndexVolume(values, lower, spacing, medium)
            else:
                found[name] = ExtinctionVolume(values, lower, spacing)
        except ValueError as error:
            raise ValueError(f"{where}: {file}: {error}") from None
    return Gas(**found)


def read_voxels(
    path: str | os.PathLike, length_unit: str
) -> tuple[NDArray[np.floating], NDArray[np.float64], NDArray[np.float64]]:
    """Return the values of a box of voxels, its lower corner and the edges of a voxel.

    A ``.npz`` with ``data (nx, ny, nz)``, the centre ``origin (3,)`` of voxel (0, 0, 0),
    ``spacing (3,)`` and perhaps ``length_unit``, as the toolkit writes volumes; a file that names
    none is taken to be in the unit that is expected, others than that are refused.
    """
    arrays = read_arrays(path)
    for key in _KEYS:
        if key not in arrays:
            raise ValueError(f"{key}: missing, expected data, origin and spacing")
        if arrays[key].dtype.kind not in "fiu":
            raise ValueError(f"{key}: found {arrays[key].dtype}, expected real numbers")
    unit = str(arrays.get("length_unit", length_unit))
    if unit != length_unit:
        raise ValueError(f"length_unit: found {unit}, expected {length_unit} as the rig's")
    origin, spacing = (np.asarray(arrays[key], np.float64) for key in _KEYS[1:])
    if origin.shape != (3,) or spacing.shape not in ((), (3,)):
        raise ValueError(f"origin, spacing: found {origin.shape}, {spacing.shape}, expected (3,)")
    return arrays["data"], origin - spacing / 2, np.broadcast_to(spacing, (3,))


def write_voxels(
    gas: IndexVolume | ExtinctionVolume, path: str | os.PathLike, length_unit: str
) -> None:
    """Write a box of voxels, no formula: `read_voxels` returns its values bit by bit."""
    if not isinstance(gas, IndexVolume | ExtinctionVolume):
        raise ValueError(f"gas: found {type(gas).__name__}, expected voxels to write to a file")
    file = io.BytesIO()
    origin = gas.lower + gas.spacing / 2
    unit = np.array(length_unit)
    np.savez(file, data=gas.values, origin=origin, spacing=gas.spacing, length_unit=unit)
    write_bytes(path, file.getvalue())


def _check_steps(values: NDArray) -> None:
    """Raise unless the type of an index resolves what differs from voxel to voxel."""
    if values.dtype.kind != "f" or values.size == 0:
        return
    span = float(values.max()) - float(values.min())
    step = float(np.finfo(values.dtype).eps)
    if 0 < span < step / FINE:
        raise ValueError(
            f"data: found {values.dtype}, in steps of {step:.1g}, for an index that differs by "
            f"{span:.2g}, expected float64"
        )
