"""How large the benchmark's problems are: in full, ``quick``, and ``tiny``, which tests run."""

from __future__ import annotations

from dataclasses import dataclass

from studies.common.flames import FlameSize


@dataclass(frozen=True)
class Sizes:
    """The numbers that make one benchmark longer than another."""

    flame: FlameSize  # for solvers, training and mismatch
    shown: FlameSize  # for accuracy and skipping
    flames: tuple[str, ...]
    seeds: tuple[int, ...]  # of flames and noises reported; settings are tuned on seed 0
    passes: int  # the most over the images that a solver is given
    repeats: int  # of timings that a median is taken of
    effects: tuple[str, ...]  # of `studies.benchmark.mismatch.EFFECTS`; all if empty
    training_steps: int  # of 3200 rays each before any is skipped
    rates: tuple[tuple[int, int], ...]  # voxels along the edge, and views, of projectors
    stored: tuple[int, int]  # the same of the stored matrix
    edges: tuple[int, ...]  # voxels along the edge as time and memory grow
    stored_edges: tuple[int, ...]
    views: tuple[int, ...]  # as these grow, of ``views_edge`` voxels along the edge
    views_edge: int
    large: tuple[int, int, int]  # voxels, views and pixels, along edges, of the memory target
    starts: int  # processes started for a median
    afresh: tuple[str, ...]  # also timed with nothing compiled, of `studies.benchmark.startup`


SIZES = {
    "full": Sizes(
        flame=FlameSize((30, 140, 30), 0.5, 2),
        shown=FlameSize((30, 140, 30), 0.5, 1),
        flames=("jet", "turbulent"),
        seeds=(1, 2),
        passes=40,
        repeats=3,
        effects=(),
        training_steps=5,
        rates=((96, 24), (192, 8)),
        stored=(64, 16),
        edges=(64, 128, 256, 384),
        stored_edges=(64, 128, 192),
        views=(4, 16, 64),
        views_edge=96,
        large=(256, 24, 512),
        starts=3,
        afresh=("kernels", "reconstruct"),
    ),
    "quick": Sizes(
        flame=FlameSize((15, 70, 15), 1.0, 4),
        shown=FlameSize((15, 70, 15), 1.0, 2),
        flames=("turbulent",),
        seeds=(1,),
        passes=20,
        repeats=3,
        effects=("gains",),
        training_steps=1,
        rates=((32, 4),),
        stored=(24, 4),
        edges=(32, 64, 96),
        stored_edges=(32, 64, 96),
        views=(4, 8, 16),
        views_edge=64,
        large=(96, 24, 192),
        starts=1,
        afresh=(),
    ),
    "tiny": Sizes(
        flame=FlameSize((6, 28, 6), 2.5, 10, supersample=2),
        shown=FlameSize((6, 28, 6), 2.5, 10, supersample=2),
        flames=("jet",),
        seeds=(1,),
        passes=6,
        repeats=1,
        effects=("gains", "all"),
        training_steps=1,
        rates=((16, 3),),
        stored=(12, 3),
        edges=(8, 12),
        stored_edges=(8,),
        views=(4,),
        views_edge=8,
        large=(12, 3, 16),
        starts=1,
        afresh=(),
    ),
}
