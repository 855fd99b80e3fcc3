"""How large the benchmark's problems are: in full, ``--quick``, and the size that tests run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """The numbers that make one benchmark longer than another.

    Attributes
    ----------
    name : str
    grid_shape, spacing
        Voxels of the flames, in the paper's box of 15 x 70 x 15 mm.
    shrink : int
        By how much the presets' images are shrunk; 2 makes a pixel as wide as a 0.5 mm voxel.
    refine, supersample : int
        Voxels finer than the grid and rays along a pixel's side when images are simulated.
    flames : tuple of str
    seeds : tuple of int
        Of the flames and noises reported; settings are tuned on seed 0.
    passes : int
        The most passes over the images that a solver is given.
    settings : int
        The most settings of a method that are tried on seed 0.
    repeats : int
        Timings a median is taken of.
    skip_shrink, mismatch_shrink : int
        Of the images of the studies of skipping and of mismatch: 1 is the presets as they are.
    mismatch_effects : tuple of str
        Which effects that study has, of `_benchmark.mismatch_scenes.EFFECTS`.
    mismatch_seeds : tuple of int
        Of its flames, gains and noise.
    training_steps : int
        Steps of WERNet's training that are timed, of 3200 rays each before any is skipped.
    edges, stored_edges : tuple of int
        Voxels along the grid's edge as time and memory grow; those for a stored matrix.
    views : tuple of int
        How many views as these grow, of ``views_edge`` voxels along the edge.
    large : (int, int, int)
        Voxels along the edge, views, and pixels along an image's edge of the memory target.
    starts : int
        Processes started for a median.
    compile_afresh : tuple of str
        What is also timed with nothing compiled, of `_benchmark.startup`.
    """

    name: str
    grid_shape: tuple[int, int, int]
    spacing: float
    shrink: int
    refine: int
    supersample: int
    flames: tuple[str, ...]
    seeds: tuple[int, ...]
    passes: int
    settings: int
    repeats: int
    skip_shrink: int
    mismatch_shrink: int
    mismatch_effects: tuple[str, ...]
    mismatch_seeds: tuple[int, ...]
    training_steps: int
    edges: tuple[int, ...]
    stored_edges: tuple[int, ...]
    views: tuple[int, ...]
    views_edge: int
    large: tuple[int, int, int]
    starts: int
    compile_afresh: tuple[str, ...]


FULL = Sizes(
    name="full",
    grid_shape=(30, 140, 30),
    spacing=0.5,
    shrink=2,
    refine=2,
    supersample=3,
    flames=("jet", "turbulent"),
    seeds=(1, 2, 3, 4, 5),
    passes=40,
    settings=3,
    repeats=5,
    skip_shrink=1,
    mismatch_shrink=1,
    mismatch_effects=(
        "gains",
        "absorption",
        "self-absorption",
        "vignetting",
        "defocus",
        "pixel area",
        "gains + absorption",
        "all",
    ),
    mismatch_seeds=(1, 2, 3, 4, 5),
    training_steps=5,
    edges=(32, 64, 96, 128, 192, 256, 384),
    stored_edges=(32, 64, 96, 128, 192),
    views=(4, 8, 16, 32, 64),
    views_edge=96,
    large=(256, 24, 512),
    starts=5,
    compile_afresh=("kernels", "reconstruct"),
)
QUICK = Sizes(
    name="quick",
    grid_shape=(15, 70, 15),
    spacing=1.0,
    shrink=4,
    refine=2,
    supersample=3,
    flames=("jet", "turbulent"),
    seeds=(1,),
    passes=20,
    settings=2,
    repeats=3,
    skip_shrink=2,
    mismatch_shrink=2,
    mismatch_effects=("gains + absorption",),
    mismatch_seeds=(1,),
    training_steps=1,
    edges=(32, 64, 96),
    stored_edges=(32, 64, 96),
    views=(4, 8, 16),
    views_edge=64,
    large=(96, 24, 192),
    starts=3,
    compile_afresh=("kernels",),
)
TINY = Sizes(
    name="tiny",
    grid_shape=(6, 28, 6),
    spacing=2.5,
    shrink=10,
    refine=2,
    supersample=2,
    flames=("jet",),
    seeds=(1,),
    passes=6,
    settings=2,
    repeats=1,
    skip_shrink=10,
    mismatch_shrink=10,
    mismatch_effects=("gains", "all"),
    mismatch_seeds=(1,),
    training_steps=1,
    edges=(8, 12),
    stored_edges=(8,),
    views=(4,),
    views_edge=8,
    large=(12, 3, 16),
    starts=1,
    compile_afresh=(),
)
