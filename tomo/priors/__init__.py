"""Priors: knowledge of the emission that does not come from the images.

===================  ==================  ========  ==============================
prior                formula             kind      solvers
===================  ==================  ========  ==============================
`Magnitude`          ``||x||²``          linear    cgls, projected_cg
`Gradient`           ``||D x||²``        linear    cgls, projected_cg (tikhonov)
`RelativeCurvature`  ``||w D^T D x||²``  linear    cgls, projected_cg (curvature)
`TotalVariation`     ``sum_v |D x|_v``   proximal  proximal_gradient (tv), mlem
`L1`                 ``sum_v |x|_v``     proximal  proximal_gradient (l1), mlem
===================  ==================  ========  ==============================

A *linear* prior is a map with `forward` and `adjoint` (`tomo.losses.LinearPrior`), a *proximal*
one has a `proximal_map` (`tomo.priors.ProximalPrior`). A new class with these methods works with
every solver of its kind, see ``docs/develop/adding_a_prior.md``::

    tomo.solvers.projected_cg(A, images, prior=MyPrior(A.active), strength=1e-3)

The bound ``x >= 0`` is a prior too, but one that every solver treats in its own way: it is the
argument ``nonnegative`` of all of them.
"""

import lazy_loader

PRIORS = {
    "magnitude": "Magnitude",
    "differences": "Gradient",
    "relative curvature": "RelativeCurvature",
    "total variation": "TotalVariation",
    "l1": "L1",
}
"""The classes by the names that `tomo.solvers.METHODS` gives the priors."""

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "curvature": ["RelativeCurvature"],
        "differences": ["Gradient", "Magnitude"],
        "total_variation": ["L1", "ProximalMap", "ProximalPrior", "TotalVariation"],
    },
)
__all__ += ["PRIORS"]
