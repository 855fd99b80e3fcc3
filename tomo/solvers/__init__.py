"""Classic solvers, one signature: ``solve(projector, measured, *, iterations, ...)``.

| name      | what it is                                                       |
|-----------|------------------------------------------------------------------|
| art       | Kaczmarz: one ray at a time                                      |
| sirt      | all rays, or ordered subsets of them, at once: least squares     |
| sart      | one view at a time                                               |
| mart      | one ray at a time, multiplicative                                |
| smart     | all rays at once, multiplicative, cross entropy                  |
| mlem      | all rays at once, multiplicative, Poisson likelihood             |
| cgls      | conjugate gradients on the normal equations                      |
| nnls      | non-negative least squares by projected conjugate gradients      |
| tikhonov  | the same with a penalty on differences of neighbours             |
| curvature | the same with a penalty on curvature, the more the darker        |
| tv        | least squares with a penalty on total variation                  |
"""

import lazy_loader

METHODS = (
    "art", "cgls", "curvature", "mart", "mlem", "nnls", "sart", "sirt", "smart", "tikhonov", "tv",
)  # fmt: skip

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "art": ["art"],
        "cgls": ["cgls"],
        "curvature": ["curvature"],
        "mart": ["mart"],
        "mlem": ["mlem"],
        "nnls": ["nnls"],
        "sart": ["sart"],
        "sirt": ["sirt"],
        "smart": ["smart"],
        "solution": ["Iteration", "Solution"],
        "tikhonov": ["tikhonov"],
        "tv": ["tv"],
    },
)
__all__ += ["METHODS"]
