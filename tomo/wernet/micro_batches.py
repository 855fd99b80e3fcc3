"""Losses and gradients of a batch in parts, so that each part stays in a core's cache."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import torch

SEGMENTS_A_PART = 16384
"""What one thread of a CPU computes at a time: its layers of 32 channels then stay near the core.
"""

SEGMENTS_A_PART_ELSEWHERE = 1 << 20
"""On another device, which works on all of them at once and takes longer to be told than to do it:
its memory is the bound, of which a part takes some 2 GB."""

Map = Callable[[Callable, Sequence], list]
"""Applies a function to every part and returns the results in the parts' order."""


@contextmanager
def on_cores(device: torch.device) -> Iterator[Map]:
    """Give a map over parts that runs each part on a core of its own.

    On a CPU every part is computed by a single thread: what it returns, and a sum of such in the
    parts' order, is the same bits for any number of threads. Elsewhere parts follow one another.
    """
    if device.type != "cpu":
        yield lambda function, parts: [function(part) for part in parts]
        return
    threads = torch.get_num_threads()
    workers = max(min(threads, os.cpu_count() or 1), 1)
    with ThreadPoolExecutor(workers, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        try:
            yield lambda function, parts: list(pool.map(function, parts))
        finally:
            torch.set_num_threads(threads)


def cut(counts: torch.Tensor, segments: int | None = None) -> list[slice]:
    """Cut rays into parts of about ``segments`` segments each.

    Parameters
    ----------
    counts : (rays,) int64
        Segments of each ray.
    segments : int, optional
        As many as suit the device of ``counts`` when None.
    """
    if not len(counts):
        return []
    if segments is None:
        on_cpu = counts.device.type == "cpu"
        segments = SEGMENTS_A_PART if on_cpu else SEGMENTS_A_PART_ELSEWHERE
    number = (torch.cumsum(counts, 0) - 1) // segments
    firsts = torch.cat([torch.tensor([0]), torch.diff(number.cpu()).nonzero()[:, 0] + 1])
    ends = [*firsts[1:].tolist(), len(counts)]
    return [slice(first, end) for first, end in zip(firsts.tolist(), ends, strict=True)]


def add_gradients(parameters: Sequence[torch.nn.Parameter], parts: Sequence[Sequence]) -> None:
    """Set the parameters' gradients to the sum of those of the parts, in the parts' order."""
    for parameter, gradients in zip(parameters, zip(*parts, strict=True), strict=True):
        total = gradients[0]
        for one in gradients[1:]:
            total = total + one
        parameter.grad = total
