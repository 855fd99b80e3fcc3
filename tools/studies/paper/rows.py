"""Every training and every run of ART that the page shows, in the order of their importance."""

from __future__ import annotations

from dataclasses import dataclass, field

from studies.paper.cases import CASE_3, NOISE
from tomo import VoxelGrid
from tomo.wernet import VARIANTS, PaperSettings

EPOCHS, TRANSFER_EPOCHS, HOMOGENEOUS_EPOCHS, READING_EPOCHS = 80, 40, 10, 10
"""Epochs of a training from scratch, as in the text; of one with the encoder of another flame, of
which the text speaks up to epoch 40; of the homogeneous set, whose number the text does not give;
of a reading. Learning rates do not depend on the number, so fewer epochs are the first of more."""

FULL, HALF, TINY = (
    VoxelGrid((30, 140, 30), 0.5),
    VoxelGrid((15, 70, 15), 1.0),
    VoxelGrid((6, 28, 6), 2.5),
)


@dataclass(frozen=True)
class Row:
    """One training of the published network, or one run of ART.

    Attributes
    ----------
    name : str
    part : str
        The table that shows it.
    flame, layout : str
    noise : float
        Standard deviation over the images' maximum.
    settings : PaperSettings
    epochs, seed : int
        The seed is that of encoder, first voxels and order of the rays.
    encoder_of : str
        The row whose encoder it starts from; empty for a new one.
    frozen : bool
        Only the voxels are trained.
    art : str
        "best": ART in place of the network, stopped nearest to the truth with the best of four
        relaxations. "plain": neither relaxed nor stopped. Empty: the network.
    grid : VoxelGrid
    """

    name: str
    part: str
    flame: str
    layout: str = CASE_3
    noise: float = 0.0
    settings: PaperSettings = field(default=PaperSettings())
    epochs: int = EPOCHS
    seed: int = 0
    encoder_of: str = ""
    frozen: bool = False
    art: str = ""
    grid: VoxelGrid = FULL

    @property
    def command(self) -> str:
        """The command that repeats it."""
        return f"python tools/paper.py --row {self.name} -o out/paper"


READINGS = {
    "chosen": {},
    "batch-norm": {"variant": "batch-norm"},
    "absolute": {"inputs": "absolute"},
    "initial-bias": {"last_bias": None},
    "100-rays": {"rays_per_step": 100},
    "400-rays": {"rays_per_step": 400},
    "3200-rays": {"rays_per_step": 3200},
    "2-blocks": {"blocks": 2},
    "4-blocks": {"blocks": 4},
    "16-channels": {"channels": 16},
    "slow-encoder": {"encoder_learning_rate": 0.0005},
    "plain-gradient": {"normalise_gradient": False},
    "absolute-error": {"loss": "absolute"},
    "large-start": {"voxel_start": 1.0},
    "text-small-steps": {
        "inputs": "absolute", "variant": "batch-norm", "encoder_learning_rate": 0.0005,
        "last_bias": None,
    },
    "text": {
        "inputs": "absolute", "variant": "batch-norm", "encoder_learning_rate": 0.0005,
        "last_bias": None, "rays_per_step": 3200,
    },
}  # fmt: skip
"""The fields in which each reading differs from the one chosen. The last is the text's."""


def _rows() -> list[Row]:
    chosen, plain = PaperSettings(), PaperSettings(normalise_gradient=False)
    rows = [
        Row("jet", "layouts", "jet"),
        Row("jet-level", "layouts", "jet", "case 1, level"),
        Row("jet-pitched", "layouts", "jet", "case 2, pitched"),
        Row("jet-on-faces", "layouts", "jet", "case 1, rows on faces"),
        Row("homogeneous", "transfer", "homogeneous", epochs=HOMOGENEOUS_EPOCHS),
        Row("homogeneous-to-jet", "transfer", "jet", encoder_of="homogeneous", frozen=True,
            epochs=TRANSFER_EPOCHS),
        Row("jet-noise-plain-art", "noise", "jet", noise=NOISE, art="plain"),
        Row("jet-noise-best-art", "noise", "jet", noise=NOISE, art="best"),
        Row("jet-noise", "noise", "jet", noise=NOISE),
        Row("turbulent", "views", "turbulent"),
        *(Row(f"turbulent-11-views-{step}-degrees", "views", "turbulent",
              f"11 views of {step} degrees") for step in (33, 22, 11)),
        *(Row(f"{source}-to-{flame}", "transfer", flame, encoder_of=source, frozen=True,
              epochs=TRANSFER_EPOCHS)
          for source, flame in (("jet", "turbulent"), ("turbulent", "jet"),
                                ("homogeneous", "turbulent"))),
        Row("homogeneous-to-turbulent-trained-on", "transfer", "turbulent",
            encoder_of="homogeneous", epochs=TRANSFER_EPOCHS),
        *(Row(f"turbulent-noise-{art}-art", "noise", "turbulent", noise=NOISE, art=art)
          for art in ("plain", "best")),
        Row("turbulent-noise", "noise", "turbulent", noise=NOISE),
        Row("jet-plain-gradient", "ablation", "jet", settings=plain),
        *(Row(f"jet-{variant}-seed-{seed}", "ablation", "jet", seed=seed,
              settings=PaperSettings(variant=variant))
          for seed in SEEDS for variant in VARIANTS
          if (variant, seed) != (chosen.variant, 0)),
        *(Row(f"{source}-to-{flame}-trained-on", "transfer", flame, encoder_of=source,
              epochs=TRANSFER_EPOCHS)
          for source, flame in (("homogeneous", "jet"), ("jet", "turbulent"),
                                ("turbulent", "jet"))),
        *(Row(f"{flame}-noise-3200-rays", "noise", flame, noise=NOISE,
              settings=PaperSettings(rays_per_step=3200)) for flame in ("jet", "turbulent")),
        *(Row(f"reading-{name}", "readings", "jet", grid=HALF, epochs=READING_EPOCHS,
              settings=PaperSettings(**changes)) for name, changes in READINGS.items()),
    ]  # fmt: skip
    return rows


SEEDS = (0, 1, 2)
"""Seeds of the ablation. Its row with bias and mask and seed 0 is ``jet``."""

ROWS = {row.name: row for row in _rows()}

PARTS = {
    "layouts": "Jet, three layouts of 33 cameras",
    "views": "Turbulent flame, 33 and 11 views",
    "ablation": "Parts of the network left out",
    "noise": "Noise of 10 % of the maximum",
    "transfer": "Encoders of other flames",
    "readings": "Readings of the text",
}
