"""Ground truth: emission fields in continuous space that any grid can sample or average.

A field is any callable that maps points ``(..., 3)`` to values ``(...)``. The fields of this
package are frozen values: equal parameters compare equal, and ``repr`` builds them again.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
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
