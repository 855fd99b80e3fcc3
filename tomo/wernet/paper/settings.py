"""Settings of the published network and of its training."""

from __future__ import annotations

import math
from dataclasses import dataclass

LAYOUTS = ("packed", "padded")


@dataclass(frozen=True)
class PaperSettings:
    """Network and training of `tomo.wernet.paper.wernet_paper`.

    Parameters
    ----------
    variant : {"batch-norm", "bias-mask", "no-bias"}
        Variant of a new encoder, see `WeightEncoder`.
    blocks : int
        Hidden blocks of a new encoder.
    inputs : {"absolute", "relative"}
        Features of a segment that the encoder sees, see `tomo.wernet.paper.RaySamples`. The
        paper's are absolute.
    layout : {"packed", "padded"}
        How a batch's rays lie in memory: one behind another, or each padded to the longest, as in
        the paper, for comparison. The result is the same but for rounding.
    normalise_gradient : bool
        See `tomo.wernet.paper.weighted_sum`.
    voxel_learning_rate, encoder_learning_rate : float
        Learning rates of Adam in the first epochs, for a measurement scaled to a maximum of one.
    halve_every : int
        Epochs between two halvings of both learning rates.
    samples_per_batch, rays_per_sample : int
        Their product is the number of rays in one step.

    Raises
    ------
    ValueError
        If a number is out of range, or the layout is unknown.
    """

    variant: str = "batch-norm"
    blocks: int = 3
    inputs: str = "absolute"
    layout: str = "packed"
    normalise_gradient: bool = True
    voxel_learning_rate: float = 0.01
    encoder_learning_rate: float = 0.0005
    halve_every: int = 5
    samples_per_batch: int = 32
    rays_per_sample: int = 100

    def __post_init__(self) -> None:
        """Check the values that the encoder and the samples do not check."""
        for name in ("halve_every", "samples_per_batch", "rays_per_sample"):
            found = getattr(self, name)
            if found < 1 or found != int(found):
                raise ValueError(f"{name}: found {found}, expected a whole number >= 1")
        for name in ("voxel_learning_rate", "encoder_learning_rate"):
            found = getattr(self, name)
            if not 0 <= found < math.inf:
                raise ValueError(f"{name}: found {found}, expected a number >= 0")
        if self.layout not in LAYOUTS:
            raise ValueError(
                f"layout: found {self.layout!r}, expected one of {', '.join(LAYOUTS)}"
            )
