"""How pixels come about, for gradients: a volume and the effects of cameras and gas as tensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.inference.state import corrected
from tomo.measurement import NoiseModel
from tomo.model import Effect, Observation, Prediction
from tomo.operators import LINEAR, TRANSPARENT, VOXEL, Absorption, LinearSystem
from tomo.wernet.projection import as_array, as_tensor, as_unknowns

Values = dict[str, NDArray[np.float64]]
Affine = tuple[NDArray[np.float64], NDArray[np.float64]]

STEP = float(np.cbrt(np.finfo(np.float64).eps))  # of central differences: errors are least


@dataclass(frozen=True, eq=False)
class ImageModel:
    """``m = s (A(q) x) + o``: what cameras show of a volume, differentiable by it and by effects.

    ``model(volume, pose=poses, gain=gains)`` returns the pixels as a tensor. Its keyword arguments
    are the names of the effects, with ``_`` for ``-``; an effect without values has none.

    Parameters
    ----------
    effects : sequence of Effect
        See `tomo.model`. Of effects on images the last acts first, as the inference has it.
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable; all when None.
    active : ActiveVoxels, optional
        The voxels that are unknowns; all when None.
    basis : {"voxel", "linear"}
        The basis functions of the emission. `tomo.model.Blur` needs the linear one.
    supersample : int
        Rays along each side of a pixel.
    absorption : Absorption
        Of gas that is known.
    brightest : float
        The brightest pixel, which the depth of gas that absorbs its own light goes by.
    form : {"auto", "stored", "on-the-fly"}
        See `LinearSystem.from_rig`.

    Raises
    ------
    ValueError
        If the basis is unknown, or two effects have one name.

    Notes
    -----
    ``s`` and ``o`` are what gains, backgrounds and fall-off make of every pixel, ``A(q)`` the
    operator by the poses, blurs and gas ``q``; at every call rays are followed anew where these
    are not zero. With ``r = s dL/dm`` the gradients are these, by gas along one ray a pixel:

    - by the volume ``A(q)^T r``, and the change of the gas where it absorbs its own light;
    - by a pose, blur or depth ``C^T r``, with the columns ``C`` of the effect at these values;
    - by a gain, background or fall-off by central differences of its formula, exact to 1e-9.

    The columns of `tomo.model.Pose` are slopes of predicted images, some per cent from the
    derivative where a flame is thin. There are no second derivatives: columns have none.
    """

    rig: Rig
    grid: VoxelGrid
    effects: Sequence[Effect] = ()
    _: KW_ONLY
    masks: Sequence[NDArray[np.bool_]] | None = None
    active: ActiveVoxels | None = None
    basis: str = VOXEL
    supersample: int = 1
    absorption: Absorption = TRANSPARENT
    brightest: float = 1.0
    form: str = "auto"

    def __post_init__(self) -> None:
        """Check the basis and the names."""
        if self.basis not in (VOXEL, LINEAR):
            raise ValueError(f"basis: found {self.basis!r}, expected {VOXEL!r} or {LINEAR!r}")
        names = [effect.name for effect in self.effects]
        if len(set(names)) < len(names):
            raise ValueError(f"effects: found {', '.join(names)}, expected each name once")

    def __call__(self, volume: torch.Tensor, **values: torch.Tensor) -> torch.Tensor:
        """Return the predicted pixels, those of `system`.

        Parameters
        ----------
        volume : (nx, ny, nz) or (voxels,) or (unknowns,) tensor
            float32 or float64.
        values : tensor
            By effect: ``(views, parameters)``, or ``(views,)`` where it has one parameter. Where
            all views share them, ``(parameters,)``, or ``()``.

        Returns
        -------
        (pixels,) tensor
            Of the type and on the device of the volume; computed on the CPU.

        Raises
        ------
        ValueError
            If there is no effect of such a name, a shape is another, values are not finite, or
            gas or a blur is negative.
        """
        known = {effect.name.replace("-", "_"): effect for effect in self.effects}
        for name in set(values) - set(known):
            raise ValueError(f"{name}: found values, expected some of: {', '.join(known)}")
        effects = {name: effect for name, effect in known.items() if name in values}
        tables = [self._table(effect, values[name]) for name, effect in effects.items()]
        flat = as_unknowns(volume, self.active or ActiveVoxels(self.grid))
        if flat.ndim > 1:
            raise ValueError(f"volume: found shape {tuple(volume.shape)}, expected one volume")
        return _Pixels.apply(_Shown(self, tuple(effects.values())), flat, *tables)

    def _table(self, effect: Effect, values: torch.Tensor) -> torch.Tensor:
        """Return an effect's values as ``(views, parameters)``."""
        views, count = len(self.rig), len(effect.parameters)
        shape = (count,) if effect.shared else (views, count)
        shapes = [shape, shape[:-1]] if count == 1 else [shape]
        if tuple(values.shape) not in shapes:
            found, expected = tuple(values.shape), " or ".join(map(str, shapes))
            raise ValueError(f"{effect.name}: found shape {found}, expected {expected}")
        return values.reshape(shape).expand(views, count)

    @cached_property
    def system(self) -> LinearSystem:
        """The equations without effects and gas: ``model.system.flatten(images)`` is measured."""
        return self._traced(self.evenly_lit(0.0))

    @cached_property
    def of_images(self) -> frozenset[str]:
        """The names of the effects that change images; the others change the equations."""
        dark, views = self.evenly_lit(0.0), len(self.rig)
        without = ((e, np.zeros((views, len(e.parameters)))) for e in self.effects)
        return frozenset(
            e.name for e, none in without if e.applied(dark, none).images is not dark.images
        )

    def evenly_lit(self, level: float) -> Observation:
        """Return images of one level, in double precision, that effects are applied to."""
        images = tuple(np.full(camera.image_size[::-1], level) for camera in self.rig)
        masks = tuple(self.masks or (np.ones(image.shape, bool) for image in images))
        return Observation(
            self.rig, images, masks, (NoiseModel(0.0),) * len(images), self.grid,
            self.absorption, supersample=self.supersample, light=self.brightest,
        )  # fmt: skip

    def equations(self, seen: Observation, unknowns: NDArray[np.floating]) -> LinearSystem:
        """Return the equations of cameras, blur and gas as observed."""
        system = self.system
        if seen.rig is not self.rig or seen.blur:
            system = self._traced(seen)
        if seen.absorption:
            means = means_of(system, unknowns) if seen.absorption.emission else None
            system = system.with_absorption(seen.absorption, means, supersample=self.supersample)
        return system

    def _traced(self, seen: Observation) -> LinearSystem:
        system = LinearSystem.from_rig(
            seen.rig, self.grid, masks=seen.masks, active=self.active, skip=False,
            supersample=self.supersample, form=self.form,
        )  # fmt: skip
        if self.basis == LINEAR:
            return system.with_linear_basis(self.supersample, seen.blur)
        if seen.blur:
            raise ValueError(f"blur: found the basis {VOXEL!r}, expected {LINEAR!r}")
        return system


def means_of(system: LinearSystem, unknowns: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the mean emission in every voxel, ``(nx, ny, nz)``."""
    projector = system.projector
    volume = projector.active.expand(unknowns).reshape(projector.grid.shape)
    return projector.voxel_means(volume)


class _Shown:
    """One call of a model: the pixels of some values, and gradients at these."""

    def __init__(self, model: ImageModel, effects: tuple[Effect, ...]) -> None:
        self.model, self.effects = model, effects
        self.of_images = [e for e in effects if e.name in model.of_images]
        self.of_rays = [e for e in effects if e.name not in model.of_images]

    def pixels(self, unknowns: NDArray[np.floating], values: Values) -> NDArray[np.floating]:
        """Return the predicted pixels, and keep what gradients need."""
        for effect in self.of_rays:
            if effect.positive and (values[effect.name] < 0).any():
                found = f"{effect.name}: found {values[effect.name].min():.4g}"
                raise ValueError(f"{found}, expected >= 0: clamp it after a step")
        (seen,) = corrected([self.model.evenly_lit(0.0)], self.of_rays, values)
        system = self.model.equations(seen, unknowns)
        self.values, self.at = values, Prediction(seen, system, unknowns)
        self.factor, self.level = self._affine(values)
        return self.factor * self.at.pixels + self.level

    def _affine(self, values: Values) -> Affine:
        """Return ``s`` and ``o``, by what the corrections do to images of zeros and of ones."""
        even = [self.model.evenly_lit(level) for level in (0.0, 1.0)]
        seen = corrected(even, self.of_images, values)
        dark, lit = (self.model.system.flatten(one.images) for one in seen)
        factor = 1 / (lit - dark)
        return factor, -dark * factor

    def gradient(self, effect: Effect | None, grad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient by an effect's table, or by the unknowns where there is none."""
        light = self.factor * grad
        if effect is None:
            return self._by_unknowns(light)
        if effect in self.of_images:
            return self._view_sums(self._image_columns(effect), grad)
        if effect.field_of is None:
            return self._view_sums(effect.columns(self.at), light)
        table = np.zeros_like(self.values[effect.name])
        table[0] = effect.columns(self.at).T @ light  # all views have the same values
        return table

    def _by_unknowns(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        system, unknowns, gas = self.at.system, self.at.unknowns, self.at.observation.absorption
        projector = system.projector
        found = projector.T @ light.astype(unknowns.dtype)
        if gas.emission:  # emission dims what is behind it; voxel means are symmetric in emission
            dims = system.dimming(gas, unknowns, means_of(system, unknowns))
            by_means = gas.emission * (dims.T @ light).reshape(projector.grid.shape)
            found = found + projector.active.compress(projector.voxel_means(by_means))
        return found

    def _image_columns(self, effect: Effect) -> NDArray[np.float64]:
        """Return the changes of the pixels by a unit, ``(parameters, pixels)``."""
        columns = []
        for k in range(len(effect.parameters)):
            step = np.zeros_like(self.values[effect.name])
            step[:, k] = STEP
            more, less = (
                self._affine({**self.values, effect.name: self.values[effect.name] + one})
                for one in (step, -step)
            )
            change = (more[0] - less[0]) * self.at.pixels + more[1] - less[1]
            columns.append(change / (2 * STEP))
        return np.array(columns)

    def _view_sums(self, columns: NDArray, grad: NDArray) -> NDArray[np.float64]:
        """Return the inner products over the pixels of each view, ``(views, parameters)``."""
        parts = pairwise(self.at.system.projector.view_ptr)
        return np.array([columns[:, start:stop] @ grad[start:stop] for start, stop in parts])


class _Pixels(torch.autograd.Function):
    """The pixels of a volume and of effects' tables."""

    @staticmethod
    def forward(shown: _Shown, volume: torch.Tensor, *tables: torch.Tensor) -> torch.Tensor:
        named = zip(shown.effects, tables, strict=True)
        values = {e.name: as_array(table, e.name).astype(np.float64) for e, table in named}
        return as_tensor(shown.pixels(as_array(volume, "volume"), values), volume)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: torch.Tensor) -> None:
        ctx.shown, *tensors = inputs
        ctx.kinds = [(one.device, one.dtype) for one in tensors]

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> tuple:
        by = zip((None, *ctx.shown.effects), ctx.kinds, ctx.needs_input_grad[1:], strict=True)
        gradient = (_Gradient.apply(ctx.shown, *one, grad[0]) if needed else None
                    for *one, needed in by)  # fmt: skip
        return None, *gradient


class _Gradient(torch.autograd.Function):
    """A gradient of `_Pixels`, which refuses to be differentiated."""

    @staticmethod
    def forward(shown: _Shown, by: Effect | None, kind: tuple, grad: Any) -> torch.Tensor:
        found = shown.gradient(by, as_array(grad, "gradient").astype(np.float64))
        return torch.as_tensor(found).to(*kind)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: torch.Tensor) -> None:
        """Keep nothing."""

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> tuple:
        raise NotImplementedError(
            "image model: found a second derivative, expected first ones: columns of effects "
            "have no derivatives; tomo.wernet.project has, by the volume"
        )
