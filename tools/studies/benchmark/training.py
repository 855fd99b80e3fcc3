"""What packing, skipping and a GPU save when WERNet is trained as its paper has it.

The jet seen by 33 views. Padded is the paper's form: every ray as long as the longest of its step,
and torch's convolutions. A form is timed in some steps of about 3200 rays, the same ones for each
but for those skipped, in turn; medians. An epoch is that times all its rays over those timed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from studies.benchmark.sizes import SIZES
from studies.common.flames import Scene, scene
from studies.common.problems import problem
from studies.common.study import Request, Tables
from studies.common.timing import in_turn
from tomo.wernet.device import adam
from tomo.wernet.micro_batches import chunk_map
from tomo.wernet.paper import RaySamples, WeightEncoder, WERNet
from tomo.wernet.paper.epoch import train_epoch

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


COLUMNS = {
    "training": "variant layout skip device rays segments steps timed_rays seconds epoch_seconds "
    "times_faster",
}


def run(request: Request) -> Tables:
    """Return a row for each encoder and form."""
    sizes = SIZES[request.size]
    request.progress(0, len(VARIANTS), "the jet's equations")
    seen = scene("jet", 33, "clean", SEED, sizes.flame)
    (every, pixels), (lit, lit_pixels) = (samples_of(seen, skip) for skip in (False, True))
    random = np.random.default_rng(SEED)
    drawn = random.permutation(len(every))[: sizes.training_steps * RAYS_A_STEP]
    kept = random.permutation(np.flatnonzero(np.isin(lit_pixels, pixels[drawn])))
    work = {False: (every, _in_steps(drawn)), True: (lit, _in_steps(kept))}
    rows: list[dict[str, Any]] = []
    for number, variant in enumerate(VARIANTS):
        request.progress(number, len(VARIANTS), variant)
        rows += _compared(variant, work, sizes.repeats)
    return {"training": rows}


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


def forms() -> tuple[tuple[str, bool, str], ...]:
    """Return `FORMS`, and `ELSEWHERE` where there is such a device."""
    return (*FORMS, ELSEWHERE) if torch.cuda.is_available() else FORMS


def _compared(
    variant: str, work: Mapping[bool, tuple[RaySamples, Steps]], repeats: int
) -> list[dict[str, Any]]:
    seconds = in_turn(
        {
            (layout, skip, device): _trainer(variant, layout, device, *work[skip])
            for layout, skip, device in forms()
        },
        repeats,
    )
    timed = {skip: sum(map(len, steps)) for skip, (_, steps) in work.items()}
    epochs = {
        form: taken * len(work[form[1]][0]) / timed[form[1]] for form, taken in seconds.items()
    }
    return [
        {
            "variant": variant,
            "layout": layout,
            "skip": skip,
            "device": device,
            "rays": len(work[skip][0]),
            "segments": len(work[skip][0].voxel),
            "steps": len(work[skip][1]),
            "timed_rays": timed[skip],
            "seconds": seconds[layout, skip, device],
            "epoch_seconds": taken,
            "times_faster": epochs[FORMS[0]] / taken,
        }
        for (layout, skip, device), taken in epochs.items()
    ]


def _trainer(
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
        with chunk_map(place) as map_chunks:
            return train_epoch(model, samples, take, iter(steps), optimiser, True, map_chunks)

    return train


def _model(variant: str, samples: RaySamples) -> WERNet:
    voxels = torch.rand(len(samples.index), generator=torch.Generator().manual_seed(SEED))
    return WERNet(WeightEncoder(variant, seed=SEED), 0.1 * voxels).to(samples.midpoint.dtype)


def _in_steps(rays: NDArray[np.int64]) -> Steps:
    """Deal out rays in steps of about the paper's size, all alike."""
    return torch.from_numpy(rays).tensor_split(max(round(len(rays) / RAYS_A_STEP), 1))
