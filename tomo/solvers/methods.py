"""The named methods: rows of one table, each an operator's basis, a loss, a prior and a solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

LEAST_SQUARES = "weighted least squares"
ROWS = "row-weighted least squares"
ENTROPY = "cross-entropy"
POISSON = "Poisson likelihood"
NONE = "none"


@dataclass(frozen=True)
class Method:
    """A combination that has a name.

    Attributes
    ----------
    name : str
        Of the method, and of its function in `tomo.solvers`.
    loss : str
        The misfit that is minimised.
    prior : str
        One of `tomo.priors.PRIORS`, or `NONE`.
    solver : str
        The function of `tomo.solvers` that minimises both. Another name than the method's takes
        the prior as an argument.
    defaults : mapping
        Arguments of the solver that have another default here.
    any_basis : bool
        Whether it takes every operator; else the voxel basis alone, stored: it goes through the
        rows of the matrix.
    """

    name: str
    loss: str
    prior: str
    solver: str
    defaults: Mapping[str, Any] = field(default_factory=dict)
    any_basis: bool = True


_ROWS = (
    Method("art", ROWS, NONE, "art", any_basis=False),
    Method("cgls", LEAST_SQUARES, NONE, "cgls"),
    Method("curvature", LEAST_SQUARES, "relative curvature", "curvature"),
    Method("l1", LEAST_SQUARES, "l1", "proximal_gradient", {"strength": 1e-3}),
    Method("mart", ENTROPY, NONE, "mart", any_basis=False),
    Method("mlem", POISSON, NONE, "mlem"),
    Method("nnls", LEAST_SQUARES, NONE, "projected_cg"),
    Method("sart", ROWS, NONE, "sart"),
    Method("sirt", ROWS, NONE, "sirt"),
    Method("smart", ENTROPY, NONE, "smart"),
    Method("tikhonov", LEAST_SQUARES, "differences", "projected_cg", {"strength": 1e-3}),
    Method("tv", LEAST_SQUARES, "total variation", "proximal_gradient", {"strength": 0.005}),
)

METHODS: Mapping[str, Method] = MappingProxyType({row.name: row for row in _ROWS})
"""By name, in alphabetical order."""
