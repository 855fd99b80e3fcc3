"""What solvers minimise: the misfit between measured and projected images.

==============  =====================================  =============================
loss            formula                                solvers
==============  =====================================  =============================
`LeastSquares`  ``||W^½ (b - A x)||² + s m ||D x||²``  cgls, projected_cg, curvature
`LeastSquares`  ``½ ||W^½ (b - A x)||² + s u R(x)``    proximal_gradient
`Poisson`       ``sum_p (A x)_p - b_p log (A x)_p``    mlem, with ``+ s l R(x)``
==============  =====================================  =============================

A prior is linear, ``D``, or proximal, ``R``: see `tomo.priors`. SIRT, SART and ART
descend least squares weighted by the reciprocal row sums of ``A``, SMART and MART the cross
entropy: those need no more than their update.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "least_squares": ["LeastSquares", "LinearPrior", "check_prior", "check_strength"],
        "poisson": ["Poisson", "ratio", "sensitivity"],
    },
)
