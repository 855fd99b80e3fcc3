"""Ground truth: emission fields in continuous space that any grid can sample or average.

A field is any callable that maps points ``(..., 3)`` to values ``(...)``. The fields of this
package are frozen values: equal parameters compare equal, and ``repr`` builds them again.

- `create` makes one by its name, those of `names`, for a box: `JetFlame`, `TurbulentFlame`,
  `Plume`, `GaussianBlobs`, `RandomHomogeneous`.
- `sample` gives the means of a field over the voxels of a grid.
- `SampledField` is a stored volume as a field.
- `field_at` is a moving field (`MovingField`) at a moment.

Examples
--------
A flame 40 mm high, its value on the axis, and a field of one's own:

>>> import phantoms
>>> flame = phantoms.create("jet", seed=3, extent=(15.0, 40.0, 15.0))
>>> bool(flame([0.0, 0.0, 0.0]) > 0)
True
>>> ball = lambda points: 1.0 * ((points**2).sum(axis=-1) < 4.0)

``tomo.simulate(rig, flame, grid)`` makes images of either.
"""

from difflib import get_close_matches
from importlib.util import find_spec
from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "blobs": ["GaussianBlobs"],
        "catalogue": ["create", "names"],
        "field": ["BoxField", "Field", "FlameField", "MovingField", "field_at"],
        "homogeneous": ["RandomHomogeneous"],
        "jet": ["JetFlame"],
        "plume": ["Plume"],
        "sampling": ["SampledField", "sample"],
        "turbulent": ["TurbulentFlame"],
    },
)


def __getattr__(name: str) -> Any:
    """Load a name on first use; say which one may be meant where there is none."""
    if name in __all__:
        return _load(name)
    if not name.startswith("_") and find_spec(f"{__name__}.{name}"):
        raise AttributeError(f"{__name__}.{name} is not loaded yet: import {__name__}.{name}")
    close = get_close_matches(name, __all__, 1)
    meant = f"did you mean {close[0]}? " if close else ""
    raise AttributeError(f"{__name__} has no {name!r}: {meant}help({__name__}) says what there is")
