"""The default WERNet as a solver: segment lengths corrected by what the images ask for.

The classic model predicts a pixel by ``p_i = sum_j a_ij x_j`` with the segment lengths ``a``. Here
each length is corrected by a factor near one::

    w_ij = a_ij (1 + e_ij)² / g_j

with the output ``e`` of an encoder that sees what optics may depend on. It is zero at first: the
weights are then the segment lengths. The gauge ``g`` keeps the mean weight in each voxel at the
mean length, and so the unit. What formulas describe, gains and gas, is found before this
(`tomo.inference`); the encoder learns what no formula covers.

1. The classic solve that predicts left-out pixels best is the baseline.
2. Outer iterations alternate between encoder and voxels. The encoder is trained at fixed voxels,
   and the voxels are solved for again with the weights that it gives. At voxels that are optimal
   for the weights, the gradient of the loss by the encoder is that with the voxels eliminated
   (envelope theorem), so that the alternation descends on it, but for the gauge, which training
   leaves out.
3. All of this is done without every eighth block of pixels. An encoder is kept where it predicts
   these better by more than chance; otherwise the result is the baseline.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo.inference.infer import FEWEST_VIEWS
from tomo.operators import VOXEL
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured, check_weights
from tomo.selection import Choice, solve_as_chosen
from tomo.selection.folds import FEW_VIEWS
from tomo.selection.left_out import LeftOut
from tomo.solvers import Iteration, Solution
from tomo.solvers.solution import Callback
from tomo.wernet.encoder import Encoder
from tomo.wernet.features import IDENTIFYING, OPTICS
from tomo.wernet.files import own_copy
from tomo.wernet.outer_iterations import EncoderTraining, OuterIterations
from tomo.wernet.rays import Rays
from tomo.wernet.settings import WernetSettings
from tomo.wernet.training import part_map, usable_device

FEW_VIEW_FEATURES = ("depth in the grid", "upstream emission")
"""Features that a new encoder sees with few views: the same from every side. Directions and
positions identify the view, and its gain would be learned as optics."""


def wernet(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 8,
    weights: ArrayLike | None = None,
    pixel_blocks: NDArray[np.int64] | None = None,
    callback: Callback | None = None,
    settings: WernetSettings | None = None,
    encoder: str | Path | Encoder | None = None,
    freeze_encoder: bool = False,
    refused: Sequence[str] = (),
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> Solution:
    """Reconstruct with weights ``length (1 + e)²`` whose correction ``e`` is learned.

    Parameters
    ----------
    projector : ProjectionOperator
        Stored, its segments with midpoints. Through a lens blur no encoder is trained. With the
        linear basis the volume holds its coefficients, see `ProjectionOperator.voxel_means`.
    measured : (pixels,) float
    iterations : int
        Outer iterations at most; none with a frozen encoder.
    weights : (pixels,), optional
        Weights of the pixels where voxels are solved for and left-out pixels predicted, for
        example inverse variances; all alike when None.
    pixel_blocks : (pixels,) int, optional
        Pixels that are left out together, see `tomo.selection.choose_by_left_out_pixels`.
    callback : callable, optional
        ``callback(index, unknowns, relative_residual)`` after the solve with segment lengths,
        index 0, and after every outer iteration; returning True stops. It is called once more at
        the end where the result is not the last of these volumes.
    settings : WernetSettings, optional
        Shape of a new encoder, and its training; the usual ones when None.
    encoder : path or Encoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Use the encoder without training it.
    refused : sequence of {"gain", "absorption"}
        Effects that no encoder may imitate: what identifies them is hidden from it.
    device : str or torch.device
        Where the encoder is trained. The voxels are solved for on the CPU.
    seed : int
        Seed of a new encoder's weights and of the order of the rays.

    Returns
    -------
    Solution
        ``weights`` holds the learned weights; None where segment lengths are kept. ``encoder`` is
        theirs, for `tomo.wernet.save_encoder`. ``settings["held_out_residual"]`` holds the
        relative residuals of left-out pixels with ``segment_lengths`` and with ``learned``
        weights; NaN where there are none.

    Raises
    ------
    ValueError
        For segments without midpoints, sizes that do not match, values that are not finite, an
        unknown device, or an encoder of other inputs.

    Notes
    -----
    On a CPU the result is the same bits for any number of threads.

    References
    ----------
    Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a Semi-Case-Wise
    and Learning-Based Way", arXiv 2010.00893.
    """
    if iterations < 0 or iterations != int(iterations):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 0")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder as well")
    record = _Record(callback)
    measured, place = check_measured(projector, measured), usable_device(device)
    training_settings = WernetSettings() if settings is None else settings
    rays = Rays.of(projector, "optics", device=place)
    if encoder is None:
        few = len(projector.views_with_pixels) <= FEW_VIEWS
        name, own = None, Encoder(
            "optics", blocks=training_settings.blocks, channels=training_settings.channels,
            silent=True, shown=FEW_VIEW_FEATURES if few else None, seed=seed,
        )  # fmt: skip
    else:
        name = "in memory" if isinstance(encoder, Encoder) else str(encoder)
        own = own_copy(encoder, ("optics",))
        if own.couples_rays:
            raise ValueError(
                "encoder: found one with batch normalisation, expected one without: the weights "
                "of a view would depend on which others are there"
            )
    hidden = [feature for effect in refused for feature in IDENTIFYING[effect]]
    seen = OPTICS if own.shown is None else own.shown
    shown = [feature for feature in seen if feature not in hidden]
    own.show_only(shown)
    own = own.to(place)
    record_of = {
        "method": "wernet",
        "iterations": 0 if freeze_encoder else int(iterations),
        "weighted": weights is not None,
        "encoder": name,
        "freeze_encoder": freeze_encoder,
        "refused": list(refused),
        "device": str(device),
        "seed": seed,
        **asdict(training_settings),
        **own.settings,
    }
    weights = check_weights(projector, weights)
    pixels = LeftOut.of(projector, measured, pixel_blocks, weights)
    choice = pixels.choose(projector)
    classic = solve_as_chosen(projector, measured, choice, weights=weights)
    with part_map(place) as map_parts:
        training = EncoderTraining(
            rays, measured, own, training_settings, iterations=max(int(iterations), 1), seed=seed,
            map_parts=map_parts, held=pixels.held,
        )  # fmt: skip
        limit = 1 if freeze_encoder else int(iterations)
        outer = OuterIterations(pixels, training, choice, limit, not freeze_encoder)
        outer.stop_reason = _nothing_to_learn(pixels, choice, shown)
        if record.add(0, projector.active.compress(classic.volume), classic.relative_residual):
            outer.stop_reason = "stopped by the callback before the first outer iteration"
        outer.run(record.add)
    return _solution(outer, record, classic, record_of)


class _Record:
    """The history of a run, and the callback that sees it."""

    def __init__(self, callback: Callback | None) -> None:
        self.began, self.callback = time.perf_counter(), callback
        self.history: list[Iteration] = []
        self.unknowns = np.zeros(0, np.float32)  # of the last solve

    def add(self, index: int, unknowns: NDArray[np.float32], residual: float) -> bool:
        """Add a solve; return whether the callback stops the run."""
        self.unknowns = unknowns
        self.history.append(Iteration(index, residual, time.perf_counter() - self.began))
        return bool(self.callback and self.callback(index, unknowns, residual))


def _nothing_to_learn(pixels: LeftOut, choice: Choice, shown: Sequence[str]) -> str:
    """Return why no weights can be learned from these views; nothing where they can."""
    projector = pixels.projector
    if not shown:
        return "nothing to learn from: all that so few views show of optics was refused"
    if not pixels.measured.any():
        return f"nothing to judge weights by: {choice.reason}"
    if len(projector.views_with_pixels) < FEWEST_VIEWS:  # whatever the weights, they fit two
        return "nothing to judge weights by: too few views, some volume reproduces any two"
    if not pixels.held.any() or pixels.held.all():
        return "nothing to judge weights by: too few pixels to leave any out"
    if projector.basis == VOXEL and not projector.rows_are_single_rays:
        return "no encoder is trained through a lens blur"
    return ""


def _solution(
    outer: OuterIterations, record: _Record, classic: Solution, settings: dict[str, Any]
) -> Solution:
    """Return the solution of all pixels with the weights that are kept, or the classic one."""
    kept, pixels, result = outer.best, outer.pixels, classic
    lengths = outer.first.held_out_residual
    if not math.isnan(outer.residual):
        lengths = pixels.residual(outer.lengths.errors)
    learned = outer.residual if kept is None else pixels.residual(kept.errors)
    both = f"relative residual of left-out pixels {learned:.4f}, segment lengths {lengths:.4f}"
    if kept is not None:
        weighted = kept.weights.projector(pixels.projector)
        choice = outer.choice or outer.first  # chosen anew, it would be by pixels learned from
        result = solve_as_chosen(weighted, pixels.measured, choice, weights=pixels.weights)
        said = f"learned weights of outer iteration {kept.number} are kept ({both})"
    elif math.isnan(learned):
        said = "segment lengths are kept"
    else:
        said = (
            "segment lengths are kept: learned weights do not predict left-out pixels surely "
            f"better ({both})"
        )
    unknowns = pixels.projector.active.compress(result.volume)
    if not np.array_equal(unknowns, record.unknowns):
        record.add(record.history[-1].index + 1, unknowns, result.relative_residual)
    done = f"all {outer.limit} outer iterations done" if outer.limit else "nothing was trained"
    return Solution(
        volume=result.volume,
        grid=result.grid,
        history=tuple(record.history),
        settings={
            **settings,
            "solved_by": dict(result.settings),
            "held_out_residual": {"segment_lengths": lengths, "learned": learned},
            "learned": kept is not None,
        },
        stop_reason=f"{outer.stop_reason or done}; {said}",
        weights=kept.weights if kept else None,
        encoder=kept.weights.encoder if kept else None,
        seconds={"solve": time.perf_counter() - record.began},
    )
