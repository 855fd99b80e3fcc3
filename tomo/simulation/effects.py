"""Effects of gas and cameras on light that the segment lengths leave out.

The model of segment lengths says that every voxel's light reaches the image undiminished and that
a pixel looks along one line. Real gas absorbs, real lenses have an aperture and darken towards the
corners, and no two cameras have the same gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.aperture import Aperture
from tomo.grid import VoxelGrid
from tomo.operators.absorption import Absorption, attenuating, transmission
from tomo.rays import Rays
from tomo.rays.pixel_rays import rays_of_pixel
from tomo.rays.ray_box import pixels_that_see
from tomo.trace import Segments, trace

if TYPE_CHECKING:
    from rigs import CameraLike
    from rigs.scene.gas import ExtinctionVolume

_STRENGTHS = ("gain_spread", "absorption", "self_absorption", "vignetting", "aperture")
OPTICS = "optics"
"""An `Effects.aperture`: that of each camera's optics in the rig."""


@dataclass(frozen=True)
class Effects:
    """Effects of a simulation that a reconstruction does not know.

    Parameters
    ----------
    gain_spread : float
        Relative standard deviation of the cameras' gains; their mean is one.
    absorption : float
        ``k``, in 1 / length: the box of the grid absorbs evenly, and ``exp(-k d)`` of a segment's
        light remains after the distance ``d`` to where its ray leaves the box towards the camera.
    self_absorption : float
        ``q``, in 1 / (emission * length): the gas absorbs where it emits, and ``exp(-q I)`` of a
        segment's light remains, with the integral ``I`` of the emission between segment and
        camera.
    vignetting : float
        Fraction of the light that is lost at the image's corners, >= 0 and < 1. The pixel at a
        fraction ``r`` of the way from the image's middle to its corner receives
        ``(1 + c r²)^-2``: the fourth power of the cosine of a field angle.
    aperture : float or "optics"
        Diameter of the entrance pupil, in the rig's length unit; 0 is a pinhole. ``optics``: that
        of each camera's `rigs.Optics`, focal length over f-number.
    focus_distance : float, optional
        Distance along the optical axis from the centre of projection to the plane in focus; that
        of the camera's `rigs.Optics` when None.
    aperture_rays : int
        Rays of a pixel where there is an aperture, see `Rays.from_camera`.

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    >>> Effects(absorption=0.1)
    Effects(gain_spread=0.0, absorption=0.1, self_absorption=0.0, vignetting=0.0, aperture=0.0, \
focus_distance=None, aperture_rays=32)
    """

    gain_spread: float = 0.0
    absorption: float = 0.0
    self_absorption: float = 0.0
    vignetting: float = 0.0
    aperture: float | str = 0.0
    focus_distance: float | None = None
    aperture_rays: int = 32

    def __post_init__(self) -> None:
        """Check every value."""
        for name in _STRENGTHS:
            value = getattr(self, name)
            if name == "aperture" and value == OPTICS:
                continue
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: found {value}, expected a number >= 0")
        if self.vignetting >= 1:
            raise ValueError(f"vignetting: found {self.vignetting}, expected a fraction below 1")
        distance = self.focus_distance
        if distance is not None and not (math.isfinite(distance) and distance > 0):
            raise ValueError(f"focus_distance: found {distance}, expected a number > 0")
        rays_of_pixel(1, self.aperture_rays)

    @property
    def any(self) -> bool:
        """Whether there is an effect at all."""
        return any(getattr(self, name) != 0 for name in _STRENGTHS)

    @property
    def absorbs(self) -> bool:
        """Whether the gas absorbs."""
        return self.absorption > 0 or self.self_absorption > 0

    def gains(self, cameras: int, seed: int = 0) -> NDArray[np.float64]:
        """Return the gains, ``(cameras,)``: log-normal, scaled to a mean of exactly one.

        The same seed gives the same gains, whatever noise is drawn from it.
        """
        # a stream of its own: gains and noise do not change each other
        stream = np.random.SeedSequence(seed, spawn_key=(1,))
        width = math.sqrt(math.log1p(self.gain_spread**2))
        gains = np.exp(width * np.random.default_rng(stream).standard_normal(cameras))
        return gains / gains.mean()

    def falloff(self, camera: CameraLike, uv: ArrayLike) -> NDArray[np.float64]:
        """Return the fraction of light, ``(N,)``, that vignetting leaves at pixels ``(N, 2)``."""
        size = np.asarray(camera.image_size, np.float64)
        square = (np.square(np.asarray(uv) - (size - 1) / 2)).sum(axis=-1)
        steepness = (1 - self.vignetting) ** -0.5 - 1
        return (1 + steepness * square / np.square(size / 2).sum()) ** -2

    def rays_per_pixel(self, supersample: int = 1) -> int:
        """Return the number of rays of a pixel: a multiple of ``supersample`` squared."""
        return rays_of_pixel(supersample, 1 if self.aperture == 0 else self.aperture_rays)

    def rays(
        self, camera: CameraLike, pixels: NDArray[np.integer] | None = None, supersample: int = 1
    ) -> Rays:
        """Return the rays of a camera's pixels, see `Rays.from_camera`."""
        lens = self._lens(camera)
        count = 1 if lens is None else self.aperture_rays
        return Rays.from_camera(camera, pixels, supersample, count, aperture=lens)

    def pixels_that_see(self, camera: CameraLike, grid: VoxelGrid) -> NDArray[np.int64]:
        """Return, ascending, the pixels that may see the grid's box, however blurred."""
        lens = self._lens(camera)
        if lens is not None:
            ends = zip(grid.lower, grid.upper, strict=True)
            corners = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 3)
            blur = lens.blur(corners @ camera.R[2] + camera.t[2]).max()
            grid = VoxelGrid((1, 1, 1), grid.extent + blur, grid.center)
        return pixels_that_see(camera, grid)

    def trace(
        self,
        rays: Rays,
        grid: VoxelGrid,
        emission: NDArray[np.floating],
        tracer: str = "march",
        extinction: ExtinctionVolume | None = None,
    ) -> Segments:
        """Return the segments of a camera's rays, their lengths times the transmission.

        ``emission`` ``(nx, ny, nz)`` or flat is the gas's on the grid, for self-absorption;
        ``extinction`` that of gas in the scene.
        """
        absorption = self.gas(extinction)
        if not absorption:
            return trace(rays, grid, tracer)
        return attenuating(grid, absorption, emission, tracer=tracer)(rays)

    def gas(self, extinction: ExtinctionVolume | None = None) -> Absorption:
        """Return the absorption of the gas, with that of gas in the scene."""
        return Absorption(self.absorption, self.self_absorption, extinction)

    def weight_ratio(
        self,
        camera: CameraLike,
        segments: Segments,
        grid: VoxelGrid,
        emission: NDArray[np.floating] | None = None,
        *,
        gain: float = 1.0,
    ) -> NDArray[np.float64]:
        """Return the true weight of every segment over its length, ``(S,)``.

        The product of gain, vignetting and absorption; the blur of an aperture, no factor of
        single segments, is left out. ``segments`` have one pixel of the camera a row, one ray a
        pixel, and midpoints from the grid's centre; self-absorption needs the ``emission``
        (voxels,).
        """
        if segments.midpoint is None:
            raise ValueError("segments midpoint: found none, expected midpoints")
        if self.self_absorption > 0 and emission is None:
            raise ValueError("emission: found none, expected it: self_absorption needs it")
        nonempty, _ = segments.without_empty()
        last = nonempty.midpoint[nonempty.ptr[1:] - 1] + np.asarray(grid.center)  # (rays, 3)
        counts = np.diff(nonempty.ptr)
        ratio = np.repeat(gain * self.falloff(camera, camera.project(last)[0]), counts)
        if self.absorbs:
            position = np.tile(camera.position, (len(last), 1))
            lines = Rays.from_lines(position, last - position)
            strengths = self.absorption, self.self_absorption
            ratio *= transmission(nonempty, lines, grid, *strengths, emission)
        return ratio

    def _lens(self, camera: CameraLike) -> Aperture | None:
        """Return a camera's aperture; None for a pinhole."""
        if self.aperture == 0:
            return None
        if isinstance(self.aperture, str):  # `OPTICS`, as was checked
            return Aperture.of(camera, self.focus_distance)
        focus = self.focus_distance
        if focus is None and camera.optics is not None:
            focus = camera.optics.focus_distance
        if focus is None:
            raise ValueError(
                f"focus_distance: camera {camera.name}: found none with an aperture of "
                f"{self.aperture}, expected one"
            )
        return Aperture(self.aperture / 2, focus)
