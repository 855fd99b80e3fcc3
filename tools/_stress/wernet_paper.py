"""The paper's WERNet under the same: it ends with a finite volume, or says that it diverged."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from _stress.row import Row, Size
from _stress.wernet_scene import Run, Scene, filled, run, scene

EPOCHS = 3


def paper_rows(seen: Scene, size: Size) -> Iterator[Row]:
    """Yield rows of the paper's method; each counts the runs that end without a word."""
    from tomo.wernet.paper import WeightEncoder, wernet_paper

    def solve(name: str, measured: np.ndarray = seen.measured, **options: object) -> Run:
        options = {"iterations": EPOCHS, **options}
        return run(name, lambda: wernet_paper(seen.projector, measured, **options))

    factors = (0.01, 100.0) if size.quick else (0.01, 0.1, 1.0, 10.0, 100.0)
    yield _row("learning rates", f"voxels' and encoder's x {factors[0]:g} to {factors[-1]:g}", [
        solve(f"x {voxels:g}, x {encoder:g}", voxel_learning_rate=0.01 * voxels,
              encoder_learning_rate=0.0005 * encoder)
        for voxels, encoder in product(factors, factors)
    ])  # fmt: skip
    pixels = len(seen.measured)
    batches = (pixels,) if size.quick else (1, 10, 1000, pixels)
    sizes = ", ".join(map(str, batches))
    yield _row("batches", f"{sizes} rays a sample, 1 and 32 samples, 32 rays or more", [
        solve(f"{rays} x {count}", rays_per_sample=rays, samples_per_batch=count, iterations=1)
        for rays, count in product(batches, (1, 32)) if rays * count >= 32
    ])  # fmt: skip
    values = (1e30, np.nan) if size.quick else (30.0, 1e3, 1e10, 1e30, np.inf, np.nan)
    exploding = f"all weights {', '.join(f'{value:g}' for value in values)}"
    yield _row("encoders that explode", exploding, [
        solve(f"weights {value:g}", encoder=filled(WeightEncoder(), value)) for value in values
    ])  # fmt: skip
    brightness = (0.0, 1e30) if size.quick else (0.0, 1e-30, 1e-6, 1e6, 1e30)
    yield _row("intensities", "x 0 to 1e30", [
        solve(f"x {factor:g}", (seen.measured.astype(np.float64) * factor).astype(np.float32))
        for factor in brightness
    ])  # fmt: skip
    kept = scene(empty_rays=True)
    share = np.mean(kept.projector.row_sums == 0)
    empty = run(
        "empty rays", lambda: wernet_paper(kept.projector, kept.measured, iterations=EPOCHS)
    )
    yield _row("rays that cross no voxel", f"{share:.0%} of the rays", [empty])
    runs = [solve(f"seed {seed}", seed=seed) for seed in range(2 if size.quick else 6)]
    errors = [seen.error(one.found.volume) for one in runs if one.found is not None]
    spread = f"error {np.mean(errors):.2f}, spread over seeds {np.std(errors):.2g}"
    yield _row("seeds", f"{len(runs)} seeds, {EPOCHS} epochs", runs, spread)


def _row(stress: str, over: str, runs: list[Run], note: str = "") -> Row:
    faults = [one.fault for one in runs if one.fault]
    stopped = sum(one.found is None or "diverged" in one.word for one in runs)
    told = "; ".join(faults[:3]) or f"{len(runs)} runs, {stopped} said that they diverged"
    return Row(f"wernet-paper: {stress}", over, len(faults), 0, "runs that end without a word",
               note=f"{told}; {note}" if note else told)  # fmt: skip
