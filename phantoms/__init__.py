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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "blobs": ["GaussianBlobs", "RandomHomogeneous"],
        "catalogue": ["create", "names"],
        "field": ["BoxField", "Field", "FlameField", "MovingField", "field_at"],
        "flames": ["JetFlame", "Plume", "TurbulentFlame"],
        "sampling": ["SampledField", "sample"],
    },
)
