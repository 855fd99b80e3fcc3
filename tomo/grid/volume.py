"""Volume: the values of every voxel, an array that knows its grid and its units."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.higher import higher
from tomo.grid.resampling import interpolated, resampled
from tomo.grid.voxel_grid import VoxelGrid

if TYPE_CHECKING:
    from trimesh import Trimesh
    from xarray import DataArray

    from rigs import CameraLike

_SUMS = ("add", "subtract", "negative", "positive", "absolute", "maximum", "minimum", "clip")
"""Functions whose results have the unit of their arguments."""


class Volume(np.ndarray):
    """The values of the voxels of a grid, ``(nx, ny, nz)``; outside the grid they are zero.

    Parameters
    ----------
    values : (nx, ny, nz) array_like
        Shared, not copied.
    grid : VoxelGrid
    length_unit : str
        Of the grid.
    value_unit : str
        Of the values, such as ``full scales per mm``; empty where it is not known.

    Raises
    ------
    ValueError
        If the shape is not the grid's, values are no real numbers, or volumes on different grids
        are combined.

    Notes
    -----
    It is a subclass of `numpy.ndarray`, and not a class with ``__array__``: `torch.from_numpy`,
    Numba, Open3D and OpenCV refuse or copy whatever is no ndarray, and what took an array before
    takes a volume now. `numpy.asarray` gives the bare array, without a copy.

    Arithmetic and NumPy's elementwise functions of volumes on one grid return a `Volume`; so do
    ``copy``, ``astype`` and ``round``. All else returns a plain array, which lies on no grid:
    slices, sums along an axis, ``reshape``. `crop` cuts a volume, and `resample` takes it to
    another grid. Sums and differences keep the unit of the values, products have none.

    Examples
    --------
    >>> volume = Volume(np.ones((2, 4, 2), np.float32), VoxelGrid((2, 4, 2), 0.5))
    >>> (2 * volume).total()
    4.0
    >>> type(volume[0]).__name__, type(volume - 1).__name__
    ('ndarray', 'Volume')
    """

    length_unit: str
    value_unit: str

    def __new__(
        cls, values: ArrayLike, grid: VoxelGrid, length_unit: str = "mm", value_unit: str = ""
    ) -> Volume:
        """Return a view of the values."""
        array = np.asarray(values)
        if array.shape != grid.shape:
            raise ValueError(
                f"volume: found shape {array.shape}, expected the grid's {grid.shape}"
            )
        if array.dtype.kind not in "buif":
            raise ValueError(f"volume: found {array.dtype}, expected real numbers")
        made = array.view(cls)
        made._grid, made.length_unit, made.value_unit = grid, length_unit, value_unit
        return made

    def __array_finalize__(self, source: Any) -> None:
        """Give no grid to what NumPy makes of a volume: it may be turned or cut."""
        self._grid: VoxelGrid | None = None
        self.length_unit = self.value_unit = ""

    @property
    def grid(self) -> VoxelGrid:
        """Where the voxels are."""
        if self._grid is None:
            raise AttributeError("volume: found no grid, expected tomo.Volume(values, grid)")
        return self._grid

    def __repr__(self) -> str:
        """Name type, grid and unit; ``print`` shows the values."""
        if self._grid is None:
            return repr(np.asarray(self))
        return f"<Volume: {self.dtype} on {self.grid!r} {self.length_unit}, {self._unit_in_words}>"

    @property
    def _unit_in_words(self) -> str:
        return self.value_unit or "unit unknown"

    def __reduce__(self) -> Any:
        """Return what `pickle` stores."""
        if self._grid is None:
            return np.asarray(self).__reduce__()
        return Volume, (np.asarray(self), self.grid, self.length_unit, self.value_unit)

    def __copy__(self) -> Volume:
        return self.copy()

    def __deepcopy__(self, memo: Any, /) -> Volume:
        return self.copy()

    def __getitem__(self, key: Any) -> Any:
        """Return a part as a plain array; the whole as a volume."""
        found = super().__getitem__(key)
        if not isinstance(found, np.ndarray):
            return found
        start = found.ctypes.data == self.ctypes.data
        is_whole = start and found.shape == self.shape and found.strides == self.strides
        return self.like(found) if is_whole else np.asarray(found)

    def __array_ufunc__(self, ufunc: Any, method: Any, *inputs: Any, **kwargs: Any) -> Any:
        """Compute on plain arrays; what is elementwise is on the grid of the volumes."""
        out = kwargs.get("out", ())
        volumes = [one for one in (*inputs, *out) if isinstance(one, Volume) and one._grid]
        for other in volumes[1:]:
            if not other.grid.coincides(volumes[0].grid):
                raise ValueError(
                    f"volumes: found {volumes[0].grid!r} and {other.grid!r}, expected one grid: "
                    "resample(grid) takes a volume to another"
                )
        if out:
            kwargs["out"] = tuple(_plain(one) for one in out)
        arrays = [_plain(one) for one in inputs]
        found = super().__array_ufunc__(ufunc, method, *arrays, **kwargs)
        if out and found is not NotImplemented:
            return out[0] if len(out) == 1 else out
        if method != "__call__" or not volumes:
            return found
        units = {one.value_unit for one in volumes}
        unit = units.pop() if len(units) == 1 and ufunc.__name__ in _SUMS else ""
        first = volumes[0]

        def on_grid(one: Any) -> Any:
            fits = isinstance(one, np.ndarray) and one.shape == first.shape
            return first.like(one, unit) if fits else one

        return tuple(map(on_grid, found)) if isinstance(found, tuple) else on_grid(found)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """Return plain arrays of what has no grid any more."""
        return _plain(super().__array_function__(func, types, args, kwargs), also_on_grid=False)

    def like(self, values: ArrayLike, value_unit: str | None = None) -> Volume:
        """Return other values on the same grid; in the same unit when None."""
        unit = self.value_unit if value_unit is None else value_unit
        return Volume(values, self.grid, self.length_unit, unit)

    def sample(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the values ``(...)`` at points ``(..., 3)``, linear between voxel centres.

        Notes
        -----
        Beyond the outermost centres the values fall to zero, which they are a voxel further.
        """
        return interpolated(np.asarray(self), self.grid, points)

    def profile(
        self, start: ArrayLike, end: ArrayLike, count: int | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return distances from ``start`` on the way to ``end``, and the values there, `sample`'s.

        Parameters
        ----------
        start, end : (3,)
        count : int, optional
            Points, both ends included; two a voxel when None.
        """
        start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
        length = float(np.linalg.norm(end - start))
        if count is None:
            count = int(np.ceil(2 * length / min(self.grid.spacing))) + 1
        part = np.linspace(0, 1, count)
        return part * length, self.sample(start + part[:, None] * (end - start))

    def project(self, camera: CameraLike, *, supersample: int = 1) -> NDArray[np.float32]:
        """Return the image ``(rows, columns)`` that a camera takes: exact line integrals.

        See `tomo.operators.image_of`.
        """
        return higher("image_of")(self, camera, supersample=supersample)

    def isosurface(self, level: float, *, closed: bool = True) -> Trimesh:
        """Return the surface where the values are ``level``, as a `trimesh.Trimesh`.

        Parameters
        ----------
        level : float
            Above zero.
        closed : bool
            Whether the grid's box closes a surface that it cuts.

        Raises
        ------
        ValueError
            If the level is not above zero.
        """
        from trimesh import Trimesh

        vertices, triangles = higher("isosurface")(np.nan_to_num(self), self.grid, level)
        if not closed:  # beyond the outermost centres there are no values
            last = self.grid.origin + np.multiply(np.subtract(self.shape, 1), self.grid.spacing)
            slack = 1e-5 * np.asarray(self.grid.spacing)  # vertices come in single precision
            inside = (vertices >= self.grid.origin - slack) & (vertices <= last + slack)
            triangles = triangles[inside.all(axis=1)[triangles].all(axis=1)]
        return Trimesh(vertices, triangles, process=False)

    def area(self, level: float) -> float:
        """Return the area of `isosurface`, without where the grid's box cuts it."""
        return float(self.isosurface(level, closed=False).area)

    def total(self) -> float:
        """Return the integral, value times length cubed; NaN counts as zero."""
        whole = np.nansum(np.asarray(self), dtype=np.float64)
        return float(whole * np.prod(self.grid.spacing))

    def crop(self, lower: ArrayLike, upper: ArrayLike) -> Volume:
        """Return the voxels with centres in a box, a view on a smaller grid.

        Raises
        ------
        ValueError
            If there are none.
        """
        lower, upper = (np.broadcast_to(np.asarray(one, np.float64), 3) for one in (lower, upper))
        axes = self.grid.axes()
        first = [int(np.searchsorted(*pair)) for pair in zip(axes, lower, strict=True)]
        stop = [int(np.searchsorted(*pair, "right")) for pair in zip(axes, upper, strict=True)]
        if not (np.subtract(stop, first) > 0).all():
            raise ValueError(
                f"crop: found no voxel with its centre between {lower.tolist()} and "
                f"{upper.tolist()}, expected corners of a part of {self.grid!r}"
            )
        part = np.asarray(self)[tuple(map(slice, first, stop))]
        origin = self.grid.origin + np.multiply(first, self.grid.spacing)
        grid = VoxelGrid.from_origin(part.shape, self.grid.spacing, origin)
        return Volume(part, grid, self.length_unit, self.value_unit)

    def resample(self, grid: VoxelGrid) -> Volume:
        """Return the volume on another grid: means where voxels are larger, else linear.

        See `tomo.grid.resampling.resampled`. Where the grid is beyond this volume's, it is zero.
        """
        values = resampled(np.asarray(self), self.grid, grid)
        return Volume(values, grid, self.length_unit, self.value_unit)

    def to_xarray(self, name: str = "emission") -> DataArray:
        """Return an `xarray.DataArray` with coordinates and units, see `tomo.io.data_array`."""
        array, units = np.asarray(self), (self.length_unit, self.value_unit)
        return higher("data_array")(array, self.grid, *units, name=name)


def _plain(found: Any, also_on_grid: bool = True) -> Any:
    """Return plain arrays in place of volumes, in tuples and lists too."""
    if isinstance(found, Volume) and (also_on_grid or found._grid is None):
        return np.asarray(found)
    if type(found) in (tuple, list):
        return type(found)(_plain(one, also_on_grid) for one in found)
    return found


def _method(name: str, keeps_grid: bool) -> Any:
    """Return a method of arrays for volumes: on the grid still, or a plain array."""
    method = getattr(np.ndarray, name)

    @wraps(method)
    def call(self: Volume, *arguments: Any, **named: Any) -> Any:
        found = method(np.asarray(self), *arguments, **named)
        return self.like(found) if keeps_grid and self._grid else found

    return call


for _name in ("astype", "copy", "round"):
    setattr(Volume, _name, _method(_name, True))
for _name in ("compress", "diagonal", "flatten", "ravel", "repeat", "reshape", "squeeze",
              "swapaxes", "take", "transpose", "view"):  # fmt: skip
    setattr(Volume, _name, _method(_name, False))
Volume.T = property(_method("transpose", False))  # type: ignore[assignment]
