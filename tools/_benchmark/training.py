"""What packing, skipping and a GPU save when WERNet is trained as its paper has it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from _benchmark.problems import problem
from _benchmark.scenes import Scene, scene
from _benchmark.sizes import Sizes
from _benchmark.solvers import Progress
from _benchmark.timing import in_turn
from tomo.wernet.device import adam
from tomo.wernet.micro_batches import on_cores
from tomo.wernet.paper import RaySamples, WeightEncoder, WERNet
from tomo.wernet.paper.wernet_paper import train_epoch

FORMS = (("padded", False, "cpu"), ("packed", False, "cpu"), ("packed", True, "cpu"))
"""How rays lie in memory, whether dark pixels and voxels are skipped, and where training runs; the
paper's first."""

ELSEWHERE = ("packed", True, "cuda")
"""Timed as well where PyTorch has such a device."""

VARIANTS = ("batch-norm", "bias-mask")
RAYS_A_STEP = 3200  # the paper's 32 samples of 100
SEED = 1

Steps = Sequence[torch.Tensor]
"""Numbers of the rays of each step, ``(rays,)`` int64."""


@dataclass(frozen=True)
class Trained:
    """One form of one encoder.

    Attributes
    ----------
    variant, layout, skip, device
        See `tomo.wernet.paper.wernet_paper` and `FORMS`.
    rays, segments : int
        Of an epoch.
    steps, timed_rays : int
        Timed. All forms take the same rays, but for those that are skipped.
    seconds : float
        That these took, the median.
    epoch_seconds : float
        ``seconds * rays / timed_rays``.
    times_faster : float
        Than the first of `FORMS`.
    gradient_difference, gradient_rounding : float or None
        See `gradient_difference`: in double precision, and in single, as trained.
    """

    variant: str
    layout: str
    skip: bool
    device: str
    rays: int
    segments: int
    steps: int
    timed_rays: int
    seconds: float
    epoch_seconds: float
    times_faster: float
    gradient_difference: float | None
    gradient_rounding: float | None


def training(sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return a row for each encoder and form, of the jet seen by 33 views."""
    progress(0, len(VARIANTS), "the jet's equations")
    seen = scene("jet", 33, "clean", SEED, sizes)
    (every, pixels), (lit, lit_pixels) = (samples_of(seen, skip) for skip in (False, True))
    random = np.random.default_rng(SEED)
    drawn = random.permutation(len(every))[: sizes.training_steps * RAYS_A_STEP]
    kept = random.permutation(np.flatnonzero(np.isin(lit_pixels, pixels[drawn])))
    work = {False: (every, _in_steps(drawn)), True: (lit, _in_steps(kept))}
    rows: list[Trained] = []
    for number, variant in enumerate(VARIANTS):
        progress(number, len(VARIANTS), variant)
        rows += _compared(variant, work, sizes.repeats)
    progress(len(VARIANTS), len(VARIANTS), "")
    return [asdict(row) for row in rows]


def samples_of(seen: Scene, skip: bool) -> tuple[RaySamples, NDArray[np.int64]]:
    """Return a scene's rays as the network takes them, and of which of all pixels each is."""
    ready = problem(seen.scan.rig, seen.scan.grid, seen.images, skip=skip, midpoints=True)
    projector = ready.system.projector
    measured = ready.measured / ready.measured.max()
    samples = RaySamples.from_segments(
        projector.segments, projector.grid, measured, active=projector.active
    )
    first = np.cumsum([0, *(image.size for image in seen.images)])
    views = zip(first, ready.system.pixels, strict=False)
    pixels = np.concatenate([start + pixels for start, pixels in views])
    return samples, pixels[samples.pixel]


def gradient_difference(variant: str, samples: RaySamples, rays: torch.Tensor) -> float:
    """Return how far the gradients of packed rays are from those of padded ones.

    The largest difference of any parameter's entries, over the largest of that parameter's.
    """
    found = {}
    for layout in ("padded", "packed"):
        model = _model(variant, samples)
        batch = getattr(samples, layout)(rays)
        loss = (model(batch) - batch.measured).square().mean()
        found[layout] = torch.autograd.grad(loss, list(model.parameters()))
    return max(
        float((packed - padded).abs().max() / padded.abs().max())
        for packed, padded in zip(found["packed"], found["padded"], strict=True)
    )


def forms() -> tuple[tuple[str, bool, str], ...]:
    """Return `FORMS`, and `ELSEWHERE` where there is such a device."""
    return (*FORMS, ELSEWHERE) if torch.cuda.is_available() else FORMS


def in_double_precision(samples: RaySamples) -> RaySamples:
    """Return the same rays as float64."""
    keys = ("midpoint", "index", "measured")
    return replace(samples, **{key: getattr(samples, key).double() for key in keys})


def _compared(
    variant: str, work: Mapping[bool, tuple[RaySamples, Steps]], repeats: int
) -> list[Trained]:
    seconds = in_turn(
        {
            (layout, skip, device): _course(variant, layout, device, *work[skip])
            for layout, skip, device in forms()
        },
        repeats,
    )
    every, steps = work[False]
    double, single = (
        gradient_difference(variant, samples, steps[0])
        for samples in (in_double_precision(every), every)
    )
    timed = {skip: sum(map(len, steps)) for skip, (_, steps) in work.items()}
    epochs = {
        form: taken * len(work[form[1]][0]) / timed[form[1]] for form, taken in seconds.items()
    }
    return [
        Trained(
            variant,
            layout,
            skip,
            device,
            rays=len(samples),
            segments=len(samples.voxel),
            steps=len(steps),
            timed_rays=timed[skip],
            seconds=seconds[form],
            epoch_seconds=epochs[form],
            times_faster=epochs[FORMS[0]] / epochs[form],
            gradient_difference=double if form == FORMS[1] else None,
            gradient_rounding=single if form == FORMS[1] else None,
        )
        for form in epochs
        for layout, skip, device in (form,)
        for samples, steps in (work[skip],)
    ]


def _course(
    variant: str, layout: str, device: str, samples: RaySamples, steps: Steps
) -> Callable[[], float]:
    """Return what takes the steps, as training does; each call goes on from the one before."""
    place = torch.device(device)
    samples = samples.to(place)
    model = _model(variant, samples).to(place)
    groups = [
        {"params": [model.voxels], "lr": 0.01},
        {"params": model.encoder.parameters(), "lr": 0.0005},
    ]
    optimiser = adam(groups, place)
    take = getattr(samples, layout)

    def train() -> float:
        with on_cores(place) as over_parts:
            return train_epoch(model, samples, take, iter(steps), optimiser, True, over_parts)

    return train


def _model(variant: str, samples: RaySamples) -> WERNet:
    voxels = torch.rand(len(samples.index), generator=torch.Generator().manual_seed(SEED))
    return WERNet(WeightEncoder(variant, seed=SEED), 0.1 * voxels).to(samples.midpoint.dtype)


def _in_steps(rays: NDArray[np.int64]) -> Steps:
    """Deal out rays in steps of about the paper's size, all alike."""
    return torch.from_numpy(rays).tensor_split(max(round(len(rays) / RAYS_A_STEP), 1))
