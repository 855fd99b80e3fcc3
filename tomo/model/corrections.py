"""What was found of cameras and gas, as a value that corrects images of any frame and size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.model.effect import Effect
from tomo.model.observation import Observation
from tomo.operators import TRANSPARENT, Absorption

Values = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Corrections:
    """The values of the effects, and pixels that nothing explains."""

    names: tuple[str, ...]  # the cameras, in the order of the values' rows
    grid: VoxelGrid
    effects: tuple[Effect, ...] = ()
    values: Values = field(default_factory=dict)
    """By effect (views, parameters); motions in pixels as recorded."""
    absorption: Absorption = TRANSPARENT  # of all gas, known and found
    untrusted: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    """By camera (height, width): neither volume nor effect explains what the pixel shows."""

    def __repr__(self) -> str:
        """Name the effects that are not zero."""
        found = [name for name, one in self.values.items() if one.any()]
        return f"<Corrections: {', '.join(found) or 'none'}>"

    def applied(self, observation: Observation, *, move: bool = True) -> Observation:
        """Return the observation without the effects, untrusted pixels masked.

        Cameras that are not among `names` stay as they are, and all do unless ``move``.
        """
        rows = [self.names.index(n) if n in self.names else None for n in observation.rig.names]
        for effect in self.effects:
            own = self.values[effect.name]
            none = np.zeros(own.shape[1])
            values = np.array([none if row is None else own[row] for row in rows])
            if values.any() and not effect.of_gas and (move or not effect.of_cameras):
                observation = effect.applied(observation, values)
        masks = tuple(
            mask & ~self.untrusted[name] if name in self.untrusted else mask
            for name, mask in zip(observation.rig.names, observation.masks, strict=True)
        )
        return replace(observation, masks=masks, absorption=self.absorption)

    @property
    def blur(self) -> tuple[float, ...] | None:
        """The variance of each image's blur, in squared pixels; None where none was found."""
        found = self.values.get("blur")
        return None if found is None or not found.any() else tuple(found[:, 0].tolist())
