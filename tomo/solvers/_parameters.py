"""The parameters that solvers have in common, documented once."""

from __future__ import annotations

from collections.abc import Callable

SHARED = {
    "projector": "projector : ProjectionOperator\n    ``A``, from the unknowns to the pixels.",
    "stored_projector": (
        "projector : Projector\n    ``A``, stored: the method goes through its rows."
    ),
    "measured": "measured : (pixels,)\n    ``b``, the images, flat.",
    "iterations": "iterations : int\n    Updates of the volume.",
    "start": "start : (voxels,), optional\n    The first volume; zeros when None.",
    "positive_start": (
        "start : (voxels,), optional\n    The first volume, not negative; a constant when None."
    ),
    "nonnegative": (
        "nonnegative : bool\n    Whether to search among volumes ``x >= 0`` only: ``max(x, 0)``."
    ),
    "always_nonnegative": (
        "nonnegative : bool\n    Must be True: a multiplicative method has no other form."
    ),
    "weights": (
        "weights : (pixels,), optional\n"
        "    The diagonal of ``W``, such as the inverse variances of the pixels; ones when None.\n"
        "    With weights the history holds ``||W^½ (b - A x)|| / ||W^½ b||``."
    ),
    "relaxation": "relaxation : float\n    ``r``, above 0 and below 2.",
    "strength": "strength : float\n    ``s``, >= 0, without a unit: how much the prior counts.",
    "seed": "seed : int\n    Seed of the order of the pixels.",
    "callback": (
        "callback : callable, optional\n"
        "    ``callback(index, volume, relative_residual)``; returns True to stop."
    ),
}
"""Paragraphs of a numpy docstring, by the name that stands in braces where they go."""


def shared_parameters(solver: Callable) -> Callable:
    """Fill in the paragraphs of `SHARED` that a solver's docstring names in braces.

    Examples
    --------
    A line ``{measured}`` under Parameters becomes the paragraph of that name; lines indented
    below it go on with the paragraph.
    """
    if solver.__doc__:  # there is none under python -OO
        for name, paragraph in SHARED.items():
            lines = paragraph.replace("\n", "\n    ")
            solver.__doc__ = solver.__doc__.replace(f"    {{{name}}}\n", f"    {lines}\n")
    return solver
