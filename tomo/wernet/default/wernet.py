"""The default WERNet as a solver: a classic solve with ray weights learned from the images."""

from __future__ import annotations

import copy
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo.operators import ProjectionOperator
from tomo.operators.vectors import additive_start, check_measured, check_weights
from tomo.selection import Choice, choose_by_left_out_pixels, solve_as_chosen
from tomo.selection.folds import FEW_VIEWS
from tomo.solvers import Solution
from tomo.solvers.solution import Callback
from tomo.wernet.default.checkpoint import Checkpoint
from tomo.wernet.default.correction import CorrectionEncoder, ViewParameters
from tomo.wernet.default.encoder_training import EncoderTraining
from tomo.wernet.default.left_out import LeftOut
from tomo.wernet.default.outer_iterations import OuterIterations
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.run import Record, run, stop_message
from tomo.wernet.device import usable_device
from tomo.wernet.encoder_file import load_encoder
from tomo.wernet.micro_batches import chunk_map

FEWEST_VIEWS = 3
"""Views that learning needs at least: whatever the weights, some volume reproduces two."""

FEW_VIEW_FEATURES = ("depth in the grid", "segment length", "upstream emission")
"""Features that a new encoder sees with few views: the same from every side. Directions and
positions identify the view, and its gain would be learned as optics."""


def wernet(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 8,
    start: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    pixel_blocks: NDArray[np.int64] | None = None,
    callback: Callback | None = None,
    encoder: str | Path | CorrectionEncoder | None = None,
    freeze_encoder: bool = False,
    blocks: int = 2,
    channels: int = 16,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> Solution:
    """Reconstruct with weights ``length (1 + c)²`` whose correction ``c`` is learned.

    The method and its formulas are described in `tomo.wernet.default`.

    Parameters
    ----------
    projector : ProjectionOperator
        Stored, its segments with midpoints. Through a lens blur gains and global terms are found,
        and no encoder is trained. With the linear basis the volume holds its coefficients, see
        `ProjectionOperator.voxel_means`.
    measured : (pixels,) float
    iterations : int
        Outer iterations at most; none with a frozen encoder.
    start : (voxels,), optional
        The voxels of the first outer iteration; those of the classic solve when None.
    weights : (pixels,), optional
        Weights of the pixels where voxels are solved for and left-out pixels predicted, for
        example inverse variances; all alike when None.
    pixel_blocks : (pixels,) int, optional
        Pixels that are left out together, see `tomo.selection.choose_by_left_out_pixels`.
    callback : callable, optional
        ``callback(index, volume, relative_residual)`` after the classic solve, index 0, after the
        solve with parametric terms, where there are any, and after every outer iteration;
        returning True stops. It is called once more at the end where the result is not the last
        of these volumes.
    encoder : path or CorrectionEncoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Use the encoder without training it.
    blocks, channels : int
        Shape of a new encoder, see `CorrectionEncoder`.
    checkpoint : path, optional
        A file to write the state to after every outer iteration.
    resume : bool
        Resume from the checkpoint, where there is one.
    device : str or torch.device
        Where the encoder is trained. The voxels are solved for on the CPU.
    seed : int
        Seed of a new encoder's weights and of the order of the rays.

    Returns
    -------
    Solution
        ``weights`` holds the learned weights; None where segment lengths are kept. ``encoder`` is
        theirs, for `tomo.wernet.save_encoder`; None where they need none.
        ``settings["held_out_residual"]`` holds the relative residuals of left-out pixels with
        ``segment_lengths`` and with ``learned`` weights; NaN where there are none.

    Raises
    ------
    ValueError
        For segments without midpoints, sizes that do not match, values that are not finite, an
        unknown device, an encoder of another kind, or a checkpoint of another problem.

    Notes
    -----
    On a CPU the result is the same bits for any number of threads.

    References
    ----------
    Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a Semi-Case-Wise
    and Learning-Based Way", arXiv 2010.00893.
    """
    record = Record(callback)
    _check(iterations, encoder, freeze_encoder)
    measured = check_measured(projector, measured)
    place = usable_device(device)
    views = len(projector.views_with_pixels)
    many = views > FEW_VIEWS
    features = RayFeatures.of(projector, place, per_view=many)
    limit = 0 if freeze_encoder else int(iterations)
    settings = {
        "method": "wernet",
        "iterations": limit,
        "start": start is not None,
        "weighted": weights is not None,
        "encoder": _name(encoder),
        "freeze_encoder": freeze_encoder,
        "device": str(device),
        "seed": seed,
    }
    if encoder is None:
        own = CorrectionEncoder(blocks=blocks, channels=channels, seed=seed)
        if not many:
            own.show_only(FEW_VIEW_FEATURES)
    elif isinstance(encoder, CorrectionEncoder):
        own = copy.deepcopy(encoder)
    else:
        own = load_encoder(encoder, CorrectionEncoder)
    own = own.to(place)
    settings |= own.settings
    view_parameters = ViewParameters(projector.n_views, own.channels).to(place)

    saved = Checkpoint.of(checkpoint, settings, projector, measured)
    state = saved.load() if saved and resume else None  # refused, if at all, before the work
    weights = check_weights(projector, weights)
    pixels = LeftOut.of(projector, measured, pixel_blocks, weights)
    how = {"blocks": pixels.blocks, "weights": weights}
    baseline = choose_by_left_out_pixels(projector, measured, **how)
    classic = solve_as_chosen(projector, measured, baseline, weights=weights)
    stop_reason = ""
    if record.add(0, projector.active.compress(classic.volume), classic.relative_residual):
        stop_reason = "stopped by the callback before the first outer iteration"
    with chunk_map(place) as map_chunks:
        training = EncoderTraining(
            features,
            measured,
            own,
            view_parameters,
            iterations=max(limit, 1),
            seed=seed,
            map_chunks=map_chunks,
            per_view=many,
            held=pixels.held,
        )
        outer = OuterIterations(
            pixels,
            training,
            baseline,
            limit=limit,
            volume=None if start is None else additive_start(projector, start, nonnegative=True),
            stop_reason=stop_reason or _nothing_to_learn(pixels, views, baseline),
        )
        # few views say too little of terms of their own; another encoder has its own
        terms = many and own.is_zero
        run(outer, record, saved, state, train=not freeze_encoder, terms=terms)
    return _solution(outer, record, classic, settings, choose_anew=not freeze_encoder)


def _check(iterations: int, encoder: object, freeze_encoder: bool) -> None:
    if iterations < 0 or iterations != int(iterations):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 0")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder as well")


def _nothing_to_learn(pixels: LeftOut, views: int, baseline: Choice) -> str:
    """Return why no weights can be learned from these views; nothing where they can."""
    if not pixels.measured.any():
        return f"nothing to judge weights by: {baseline.reason}"
    if views < FEWEST_VIEWS:
        return "nothing to judge weights by: too few views, some volume reproduces any two"
    if not pixels.held.any() or pixels.held.all():
        return "nothing to judge weights by: too few pixels to leave any out"
    return ""


def _name(encoder: str | Path | CorrectionEncoder | None) -> str | None:
    """Return the file of a given encoder for the record of settings."""
    if isinstance(encoder, CorrectionEncoder):
        return "in memory"
    return None if encoder is None else str(encoder)


def _solution(
    outer: OuterIterations,
    record: Record,
    classic: Solution,
    settings: dict[str, Any],
    *,
    choose_anew: bool,
) -> Solution:
    """Return the solution of all pixels with the weights that are kept, or the classic one."""
    kept, pixels = outer.best, outer.pixels
    result = classic
    if kept is not None:
        learned, choice = kept.weights.projector(pixels.projector), outer.choice
        if choose_anew:
            how = {"blocks": pixels.blocks, "weights": pixels.weights}
            choice = choose_by_left_out_pixels(learned, pixels.measured, **how)
        result = solve_as_chosen(learned, pixels.measured, choice, weights=pixels.weights)
    returned = outer.projector.active.compress(result.volume)
    if not np.array_equal(returned, record.volume):
        record.add(record.history[-1].index + 1, returned, result.relative_residual)
    residuals = dict(zip(("segment_lengths", "learned"), outer.residuals(), strict=True))
    done = f"all {outer.limit} outer iterations done" if outer.limit else "nothing was trained"
    stop_reason = outer.stop_reason or done
    return Solution(
        volume=result.volume,
        grid=outer.projector.grid,
        history=tuple(record.history),
        settings={
            **settings,
            "solved_by": dict(result.settings),
            "held_out_residual": residuals,
            "learned": kept is not None,
        },
        stop_reason=stop_message(stop_reason, kept, tuple(residuals.values())),
        weights=kept.weights if kept else None,
        encoder=kept.weights.encoder if kept and not kept.weights.encoder.is_zero else None,
        seconds={"solve": time.perf_counter() - record.began},
    )
