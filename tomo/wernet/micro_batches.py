"""Losses and gradients of a batch in micro-batches, each small enough for a core's cache."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import torch

CPU_SEGMENTS = 16384
"""Segments in a micro-batch on a CPU. More: 32 channels of them leave the core's cache. Fewer:
the time goes into starting operations."""

GPU_SEGMENTS = 1 << 20
"""Segments in a micro-batch elsewhere, some 2 GB of layers. More may not fit the device's memory;
fewer leave it idle."""

ChunkMap = Callable[[Callable, Sequence], list]
"""Applies a function to every chunk and returns the results in the order of the chunks."""


@contextmanager
def chunk_map(device: torch.device) -> Iterator[ChunkMap]:
    """Give a map over chunks of work that suits the device.

    On a CPU each chunk is computed by one thread, several chunks at once. A sum of the results in
    the order of the chunks is therefore the same bits for any number of threads. On another
    device chunks follow one another.
    """
    if device.type != "cpu":
        yield lambda function, chunks: [function(chunk) for chunk in chunks]
        return
    threads = torch.get_num_threads()
    workers = max(min(threads, os.cpu_count() or 1), 1)
    with ThreadPoolExecutor(workers, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        try:
            yield lambda function, chunks: list(pool.map(function, chunks))
        finally:
            torch.set_num_threads(threads)


def micro_batches(counts: torch.Tensor, segments: int | None = None) -> list[slice]:
    """Cut a batch of rays into slices of about ``segments`` segments each.

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
        segments = CPU_SEGMENTS if counts.device.type == "cpu" else GPU_SEGMENTS
    number = (torch.cumsum(counts, 0) - 1) // segments  # (rays,)
    firsts = torch.cat([torch.tensor([0]), torch.diff(number.cpu()).nonzero()[:, 0] + 1])
    ends = [*firsts[1:].tolist(), len(counts)]
    return [slice(first, end) for first, end in zip(firsts.tolist(), ends, strict=True)]


def set_summed_gradients(
    parameters: Sequence[torch.nn.Parameter], gradients: Sequence[Sequence[torch.Tensor]]
) -> None:
    """Set the parameters' gradients to the sum over micro-batches, in their order."""
    for parameter, parts in zip(parameters, zip(*gradients, strict=True), strict=True):
        total = parts[0]
        for part in parts[1:]:
            total = total + part
        parameter.grad = total
