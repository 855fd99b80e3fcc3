"""Solvers, one signature: ``solve(A, images, *, iterations, start, nonnegative, callback, ...)``.

=========  ============================================================
name       loss, prior and update
=========  ============================================================
art        one ray at a time: Kaczmarz
sart       one view at a time
sirt       all rays, or ordered subsets of them, at once: least squares
mart       one ray at a time, multiplicative
smart      all rays at once, multiplicative: cross entropy
mlem       all rays at once, multiplicative: Poisson likelihood
cgls       conjugate gradients: least squares
nnls       projected conjugate gradients: non-negative least squares
tikhonov   the same with a prior on differences of neighbours
curvature  the same with a prior on curvature, larger where it is dark
tv         proximal gradients: least squares with total variation
l1         the same with the sum of magnitudes
=========  ============================================================

A method is a row of `METHODS`: a name for a loss (`tomo.losses`), a prior (`tomo.priors`) and a
solver. `cgls` and `projected_cg` take any linear prior, `proximal_gradient` and `mlem` any
proximal one; ``nnls``, ``tikhonov``, ``tv`` and ``l1`` are no more than that. Every solver returns
a `Solution` with its history. The parameters that they share are documented once, in
`tomo.solvers.iterate`, and ``help(solver)`` shows all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "art": ["art"],
        "cgls": ["cgls"],
        "combinations": ["l1", "nnls", "tikhonov", "tv"],
        "curvature": ["curvature"],
        "mart": ["mart"],
        "methods": ["METHODS", "Method"],
        "mlem": ["mlem"],
        "projected_cg": ["projected_cg"],
        "proximal_gradient": ["proximal_gradient"],
        "sart": ["sart"],
        "sirt": ["sirt"],
        "smart": ["smart"],
        "solution": ["Iteration", "Solution"],
    },
)
