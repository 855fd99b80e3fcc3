"""Classic solvers, one signature: ``solve(projector, measured, *, iterations, ...)``.

| name | what it is                                              |
|------|---------------------------------------------------------|
| art  | Kaczmarz: one ray at a time                             |
| sirt | all rays at once, weighted least squares                |
| sart | one view at a time                                      |
| mart | one ray at a time, multiplicative                       |
| mlem | all rays at once, multiplicative, Poisson likelihood    |
| cgls | conjugate gradients on the normal equations             |
"""

import lazy_loader

METHODS = ("art", "cgls", "mart", "mlem", "sart", "sirt")

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "art": ["art"],
        "cgls": ["cgls"],
        "mart": ["mart"],
        "mlem": ["mlem"],
        "sart": ["sart"],
        "sirt": ["sirt"],
        "stopping": ["choose_by_held_out_views", "Choice"],
    },
)
__all__ += ["METHODS"]
