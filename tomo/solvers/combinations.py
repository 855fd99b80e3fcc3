"""The methods that are no more than a prior in one of the two solvers for any prior."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from tomo import priors
from tomo.solvers.iterate import shared_parameters
from tomo.solvers.methods import METHODS, NONE
from tomo.solvers.projected_cg import projected_cg
from tomo.solvers.proximal_gradient import proximal_gradient
from tomo.solvers.solution import Solution

_SOLVERS = {"projected_cg": projected_cg, "proximal_gradient": proximal_gradient}


def combined(name: str, summary: str, notes: str) -> Callable[..., Solution]:
    """Return the function of a method of the table: its solver with its prior and defaults.

    ``name`` is a method whose solver takes a prior; ``summary`` and ``notes`` are the
    function's docstring, above its parameters and below them.
    """
    row = METHODS[name]
    solver = _SOLVERS[row.solver]
    settled = {"prior", "method"} | ({"strength"} if row.prior == NONE else set())
    signature = inspect.signature(solver)
    parameters = {
        key: parameter.replace(default=row.defaults.get(key, parameter.default))
        for key, parameter in signature.parameters.items()
        if key not in settled
    }
    signature = signature.replace(parameters=list(parameters.values()))

    def method(*images: Any, **given: Any) -> Solution:
        arguments = signature.bind(*images, **given).arguments
        if row.prior != NONE:
            made_of = getattr(priors, priors.PRIORS[row.prior])
            arguments["prior"] = made_of(arguments["projector"].active)
        return solver(**{**row.defaults, **arguments}, method=name)

    method.__name__ = method.__qualname__ = name
    method.__signature__ = signature  # type: ignore[attr-defined]
    listed = "".join(f"    {{{key}}}\n" for key in parameters)
    method.__doc__ = (
        f"{summary}\n\n    Parameters\n    ----------\n{listed}\n    Notes\n    -----\n    {notes}"
    )
    return shared_parameters(method)


nnls = combined(
    "nnls",
    """Find the volume of least squares that is not negative.

    As fast as CGLS, but the volume is the best of the non-negative ones instead of the best of
    all, clipped. On noisy images it must be stopped early.""",
    """Minimises ``||W^½ (b - A x)||²`` over ``x >= 0`` by `tomo.solvers.projected_cg`, without a
    prior; without the bound it is CGLS.

    References
    ----------
    Lawson and Hanson, "Solving Least Squares Problems" (1974), chapter 23.
    """,
)

tikhonov = combined(
    "tikhonov",
    """Reconstruct a smooth volume: the prior counts differences of neighbours.

    It smooths noise and edges alike; `tomo.solvers.tv` keeps edges. Voxels that no ray meets
    follow their neighbours. Strengths are about 1e-4 for faint noise, 1e-2 for a lot.""",
    """Minimises ``||W^½ (b - A x)||² + s m ||D x||²`` over ``x >= 0`` by
    `tomo.solvers.projected_cg`. ``D`` takes the differences of neighbouring voxels
    (`tomo.priors.Gradient`), ``m`` is the largest element of ``A^T W A 1``: the strength ``s`` has
    no unit, and the volume scales with the images.

    References
    ----------
    Tikhonov, "Solution of incorrectly formulated problems and the regularization method", Soviet
    Mathematics 4 (1963).
    """,
)

tv = combined(
    "tv",
    """Reconstruct a smooth volume that keeps edges: the prior counts the size of gradients.

    Voxels that no ray meets follow their neighbours. Strengths are about 1e-4 for faint noise,
    1e-2 for a lot.""",
    """Minimises ``½ ||W^½ (b - A x)||² + s u TV(x)`` over ``x >= 0`` by
    `tomo.solvers.proximal_gradient`. ``TV`` is the sum of the lengths of the gradient
    (`tomo.priors.TotalVariation`); ``u`` the largest magnitude in ``A^T W b``. With it the
    strength ``s`` has no unit: the volume scales exactly with the images, and neither the scale of
    the weights, nor the unit of length, nor the number of rays matters; at about ``s = 1``
    everything vanishes. The strength that noise asks for grows with the noise and falls with the
    square root of the number of rays.

    References
    ----------
    Rudin, Osher and Fatemi, Physica D 60 (1992).
    """,
)

l1 = combined(
    "l1",
    """Reconstruct a volume of few bright voxels: the prior counts the sum of magnitudes.

    For sparks and particles in the dark. All light is dimmed a little.""",
    """Minimises ``½ ||W^½ (b - A x)||² + s u sum |x|`` over ``x >= 0`` by
    `tomo.solvers.proximal_gradient` (`tomo.priors.L1`). ``u`` is the largest magnitude in
    ``A^T W b``: the strength ``s`` has no unit, and at ``s = 1`` everything vanishes.

    References
    ----------
    Daubechies, Defrise and De Mol, "An iterative thresholding algorithm for linear inverse
    problems with a sparsity constraint", Communications on Pure and Applied Mathematics 57 (2004).
    """,
)
