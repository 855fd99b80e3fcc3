"""The default WERNet: a classic solve whose ray-voxel weights are learnt from the images."""

from __future__ import annotations

import copy
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from tomo.operators import VOXEL, ProjectionOperator
from tomo.operators.vectors import additive_start, check_measured, check_weights
from tomo.selection import choose_by_held_out_views
from tomo.selection.choose import FEW_VIEWS, solve_as_chosen
from tomo.solvers import Iteration, Solution
from tomo.solvers.solution import Callback
from tomo.wernet.default.alternation import Alternation
from tomo.wernet.default.checkpoint import Checkpoint
from tomo.wernet.default.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.default.outer_iterations import Rounds, reason
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.device import usable_device
from tomo.wernet.encoder_file import load_encoder
from tomo.wernet.micro_batches import on_cores

FEW_VIEW_ROUNDS = 2
FEW_VIEWS_WORTH = 1.02
"""With few views, views cannot be spared to tell whether the weights are better: what is learnt is
common to all of them, is little, and is kept unless the left-out views are predicted worse by more
than this factor."""

WIDEST_WITH_FEW_VIEWS = 1.0
"""Voxels. Where so few views ask for a wider smooth basis, most of what the chord lengths do not
explain is detail that the basis lacks."""

SEEN_OF_FEW_VIEWS = ("depth in the grid", "chord", "emission in front")
"""What a new encoder is shown of few views: the same from every side. Rays' directions, and where
they cross voxels, name the view. Of cameras whose gains differ by a tenth, four taught by all
features what predicted a fifth 0.7 to 1.9 dB worse than chords do, and by these within 0.1 dB; of
gas that absorbs, 0.2 to 0.5 dB better, and by these 0.4 to 0.8."""


def wernet(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 8,
    start: ArrayLike | None = None,
    weights: ArrayLike | None = None,
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
    """Reconstruct with weights ``length (1 + c)²`` whose correction ``c`` an encoder learns.

    It starts from the classic solve that predicts left-out views best, and from trends along the
    rays and levels of the views found by `tomo.wernet.default.variable_projection`. Then rounds
    alternate: the encoder is trained at fixed voxels (`tomo.wernet.default.alternation`), and the
    classic solve is done again with the weights that it gives. Every other round method,
    smoothness and stop are chosen anew. What predicts the left-out views best is returned: unless
    that is clearly better than the chord lengths do, or, of a first guess or with few views, not
    clearly worse, the classic solve itself.

    Parameters
    ----------
    projector : ProjectionOperator
        Stored, its segments with midpoints. Through a lens blur levels and trends are found; an
        encoder, which sees single rays, is not trained then. With the linear basis it is, given
        the light that pixels see of neighbouring rays by the current weights; the volume is that
        of coefficients, see `ProjectionOperator.voxel_means`.
    measured : (pixels,)
    iterations : int
        Rounds; none with a frozen encoder.
    start : (voxels,), optional
        The voxels of the first round; those of the classic solve when None.
    weights : (pixels,), optional
        What pixels are worth where voxels are solved for and left-out views judged, such as the
        inverse variances of their noise; all alike when None.
    callback : callable, optional
        ``callback(index, volume, relative_residual)`` for the classic solve, index 0, for the
        first guess, 1, where there is one, and after every round; returning True stops. Called
        once more at the end where what is returned is not the last of these.
    encoder : path or CorrectionEncoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Use the encoder as it is.
    blocks, channels : int
        Of a new encoder.
    checkpoint : path, optional
        A file to write the state to after every round.
    resume : bool
        Go on from the checkpoint, where there is one.
    device : str or torch.device
        Where the encoder is trained. The voxels are solved for on the CPU.
    seed : int
        Of a new encoder's weights and of the order of the rays.

    Returns
    -------
    Solution
        ``weights`` holds what was learnt; None where the chord lengths stay. ``encoder`` is that
        of the weights, which `tomo.wernet.save_encoder` writes; None where they need none.
        ``settings["held_out_residual"]`` are the left-out views' relative residuals, of the chord
        lengths and of what was learnt; NaN where nothing was.

    Raises
    ------
    ValueError
        For segments without midpoints, sizes that do not match, values that are not finite, an
        unknown device, an encoder of another kind, or a checkpoint of another problem.

    Notes
    -----
    On a CPU the result is the same bits for any number of threads.

    At voxels that are optimal for the weights, the gradient of the loss to the encoder is that of
    the loss with the voxels eliminated (variable projection, by the envelope theorem): the
    alternation goes downhill on that.

    References
    ----------
    Weights from an encoder: Pan, Li, Xu, arXiv 2010.00893. Eliminating the linear unknowns: Golub
    and Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose
    variables separate", SIAM Journal on Numerical Analysis 10 (1973).
    """
    began = time.perf_counter()
    if iterations < 0 or iterations != int(iterations):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 0")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder beside it")
    measured = check_measured(projector, measured)
    place = usable_device(device)
    tells_views = np.count_nonzero(np.diff(projector.view_ptr)) > FEW_VIEWS
    features = RayFeatures.of(projector, place, tells_views=tells_views)
    settings: dict[str, Any] = {
        "method": "wernet",
        "iterations": 0 if freeze_encoder else int(iterations),
        "start": start is not None,
        "weighted": weights is not None,
        "encoder": "in memory"
        if isinstance(encoder, CorrectionEncoder)
        else encoder and str(encoder),
        "freeze_encoder": freeze_encoder,
        "device": str(device),
        "seed": seed,
    }
    if encoder is None:
        encoder = CorrectionEncoder(blocks=blocks, channels=channels, seed=seed)
        if not tells_views:
            encoder.look_at(SEEN_OF_FEW_VIEWS)
    elif isinstance(encoder, CorrectionEncoder):
        encoder = copy.deepcopy(encoder)
    else:
        encoder = load_encoder(encoder, CorrectionEncoder)
    settings |= encoder.settings
    encoder.to(place)
    tokens = ViewTokens(projector.n_views, encoder.channels).to(place)

    weights = check_weights(projector, weights)
    chord_choice = choose_by_held_out_views(projector, measured, weights=weights)
    classic = solve_as_chosen(projector, measured, chord_choice, weights=weights)
    volume = noted = projector.active.compress(classic.volume)
    history = [Iteration(0, classic.relative_residual, time.perf_counter() - began)]
    stopped = bool(callback and callback(0, volume, classic.relative_residual))
    if start is not None:
        volume = additive_start(projector, start, nonnegative=True)
    unit = float(np.sqrt(np.mean(np.square(measured, dtype=np.float64)))) or 1.0
    last = settings["iterations"] if tells_views else min(settings["iterations"], FEW_VIEW_ROUNDS)
    ended = ""
    if stopped:
        ended = "stopped by the callback before the first round"
    if math.isnan(chord_choice.held_out_residual):
        ended = f"nothing to judge by: {chord_choice.reason}"
    elif not tells_views and chord_choice.width > WIDEST_WITH_FEW_VIEWS and not freeze_encoder:
        ended = "few views, which allow no detail: smoothness would be taken for optics"

    def note(index: int, residual: float) -> bool:
        """Add what was just solved for to the history; return whether the callback stops."""
        nonlocal noted
        noted = rounds.volume
        history.append(Iteration(index, residual, time.perf_counter() - began))
        return bool(callback and callback(index, rounds.volume, residual))

    with on_cores(place) as over_parts:
        alternation = Alternation(
            features,
            measured,
            encoder,
            tokens,
            rounds=max(settings["iterations"], 1),
            seed=seed,
            over_parts=over_parts,
        )
        rounds = Rounds(
            projector, measured, alternation, chord_choice, volume, unit, last, ended, weights
        )
        saved = Checkpoint.of(checkpoint, settings, projector, measured)
        state = saved.load() if saved and resume and not ended else None
        if state is not None:
            with saved.damages():
                rounds.restore(state)
        elif tells_views and last and not ended:
            found = rounds.guess()
            residual = rounds.solve_guess() if found and start is None else math.nan
            if saved:
                saved.save(rounds.state())
            if not math.isnan(residual) and note(1, residual):
                rounds.ended = "stopped by the callback after the first guess"
        blurred = projector.basis == VOXEL and not projector.rows_are_single_rays
        if blurred and not (freeze_encoder or rounds.ended):
            rounds.ended = "out of focus, where single lines teach an encoder nothing"
        while not rounds.ended and (rounds.done < last or (freeze_encoder and not rounds.done)):
            residual = rounds.round(train=not freeze_encoder)
            if math.isnan(residual):
                break
            if saved and not freeze_encoder:
                saved.save(rounds.state())
            if note(rounds.done + rounds.guessed, residual):
                rounds.ended = f"stopped by the callback after round {rounds.done}"
    best, result = rounds.best, rounds.kept(FEW_VIEWS_WORTH)
    volume, residual = (
        (result.volume, result.relative_residual)
        if result
        else (classic.volume, classic.relative_residual)
    )
    returned = projector.active.compress(volume)
    if not np.array_equal(returned, noted):  # what is returned stands last
        rounds.volume = returned
        note(history[-1].index + 1, residual)
    judged = {
        "chords": chord_choice.held_out_residual,
        "learned": best.held_out_residual if best else math.nan,
    }
    return Solution(
        volume=volume,
        grid=projector.grid,
        history=tuple(history),
        settings={
            **settings,
            "solved_by": result.solved_by if result else dict(classic.settings),
            "held_out_residual": judged,
            "learned": result is not None,
        },
        stop_reason=reason(
            rounds.ended or f"all {last} rounds done", result, tuple(judged.values())
        ),
        weights=result.weights if result else None,
        encoder=result.weights.encoder if result and not result.weights.encoder.is_zero else None,
        seconds={"solve": time.perf_counter() - began},
    )
