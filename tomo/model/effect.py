"""What an effect is: a way in which cameras or gas change images, with a prior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.model.observation import Observation
from tomo.operators import LinearSystem


@dataclass(frozen=True, eq=False)
class Prediction:
    """The images that ``unknowns`` (unknowns,) show of an observation, as corrected so far."""

    observation: Observation
    system: LinearSystem
    unknowns: NDArray[np.float32]

    @cached_property
    def pixels(self) -> NDArray[np.float64]:
        """``A x``, ``(pixels,)``."""
        return np.asarray(self.system.projector @ self.unknowns, np.float64)

    @cached_property
    def images(self) -> list[NDArray[np.float64]]:
        """``A x`` as images, ``(height, width)`` each; zero where no row is."""
        images = self.system.images(self.pixels.astype(np.float32))
        return [image.astype(np.float64) for image in images]

    @cached_property
    def turned(self) -> NDArray[np.float64]:
        """Changes of ``A x`` by cameras that walk around the world's axes, ``(3, pixels)``.

        For an angle of one radian about each axis through the grid's middle.
        """
        projector = self.system.projector
        grid, active = projector.grid, projector.active
        volume = active.expand(self.unknowns).reshape(grid.shape).astype(np.float64)
        padded = np.pad(volume, 1)
        slope = [
            np.gradient(padded, axis=axis)[1:-1, 1:-1, 1:-1] / step
            for axis, step in enumerate(grid.spacing)
        ]
        axes = [
            low + step * (np.arange(n) + 0.5) - middle
            for low, step, n, middle in zip(
                grid.lower, grid.spacing, grid.shape, grid.center, strict=True
            )
        ]
        x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
        fields = (y * slope[2] - z * slope[1], z * slope[0] - x * slope[2],
                  x * slope[1] - y * slope[0])  # fmt: skip
        found = [projector @ active.compress(field.astype(np.float32)) for field in fields]
        return np.asarray(found, np.float64)

    def changed_by(self, effect: Effect, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of ``A x`` by an effect of ``values``, to first order, ``(pixels,)``.

        ``values`` are ``(views, parameters)``; all views have those of a field.
        """
        columns = effect.columns(self)
        if effect.field_of is not None:
            return columns @ values[0]
        of_pixels = np.repeat(values, np.diff(self.system.projector.view_ptr), axis=0)
        return np.einsum("kp,pk->p", columns, of_pixels)

    def of_view(self, number: int, image: NDArray) -> NDArray[np.float64]:
        """Return the pixels of view ``number`` that take part, of an image, ``(rows,)``."""
        return np.asarray(image, np.float64).ravel()[self.system.pixels[number]]


class Effect(Protocol):
    """A way in which cameras or gas change images."""

    @property
    def name(self) -> str:
        """What reports call it."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters; each view has its own."""

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""

    @property
    def shared(self) -> bool:
        """Whether all views share one value."""

    @property
    def positive(self) -> bool:
        """Whether no value is below zero."""

    @property
    def of_cameras(self) -> bool:
        """Whether it moves cameras, and does not change images."""

    @property
    def of_gas(self) -> bool:
        """Whether it changes the operator by gas, and not images."""

    @property
    def field_of(self) -> str | None:
        """The effect that is the constant part of a field; None where it is none.

        It is let loose with the field, which has many parameters that all views share: none is
        below zero, most are zero, and `columns` is an operator.
        """

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviation of every parameter, ``(views, parameters)``."""

    def columns(self, at: Prediction) -> NDArray[np.float64] | LinearOperator:
        """Return the change of the prediction by a unit of a view's own parameters.

        ``(parameters, pixels)``; a pixel has the column of its own view.
        """

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation without the effect, ``values`` ``(views, parameters)``."""


class OfOneParameter:
    """What effects of one parameter have in common; as here, images alone change, view by view."""

    sigma: float
    units: tuple[str, ...] = ("",)
    shared = False
    positive = True
    of_cameras = False
    of_gas = False
    field_of: str | None = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma)


def image_frame(
    size: tuple[int, int], center: tuple[float, float] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return pixel coordinates from the image's middle, in half its shorter side, and that radius.

    ``size`` is (width, height), ``center`` the (column, row) that coordinates count from.
    """
    width, height = size
    cx, cy = ((width - 1) / 2, (height - 1) / 2) if center is None else center
    radius = min(width, height) / 2
    y, x = np.mgrid[:height, :width].astype(np.float64)
    return (x - cx) / radius, (y - cy) / radius, radius
