"""Cameras in another order: the same volume within rounding, and the same cameras named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rigs import Rig
from studies.common.scans import reconstructed
from studies.common.study import Request
from studies.stress.calibration_scene import noisier, one_off, simulated
from studies.stress.row import Row, relative_error
from tomo import Scan
from tomo.pipeline import Reconstruction
from tomo.simulation.simulate import SimulatedImages

NOISE = 0.02
ORDERS, QUICK_ORDERS = 3, 1
ROUNDING = 1e-4
"""Part of the volume's norm: sums in another order, in float32, through some thirty solves."""

WRONG = 3


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    count = QUICK_ORDERS if request.size != "full" else ORDERS
    scans = wrong_scans(noisier(simulated(request.seed), NOISE, request.seed))
    random = np.random.default_rng(request.seed)
    for name in request.each(scans, str):
        names = scans[name].rig.names
        orders = [random.permutation(len(names)) for _ in range(count)]
        permuted = ([names[n] for n in order] for order in orders)
        yield from order_rows(name, scans[name], [list(names[::-1]), *permuted])


def wrong_scans(flame: SimulatedImages) -> dict[str, Scan]:
    """Return the scan as it is, and with one camera that is wrong."""
    scan, name = flame.scan, flame.rig.names[WRONG]
    images = dict(zip(scan.rig.names, scan.read()[0], strict=True))
    own = images[name]
    changed = {"darker by a fifth": own * np.float32(0.8), "mirrored": own[:, ::-1]}
    return {
        "as it is": scan,
        "a camera 2 px off": one_off(flame, WRONG, 2.0),
        **{
            f"a camera {what}": Scan.from_arrays(
                scan.rig, images | {name: np.ascontiguousarray(image)}, scan.grid
            )
            for what, image in changed.items()
        },
    }


def order_rows(name: str, scan: Scan, orders: list[list[str]]) -> Iterator[Row]:
    """Compare reconstructions of the cameras in other orders with that of their own."""
    first = reconstructed(scan, uncertainty=0)
    changed, faults = [], []
    for number, order in enumerate(orders):
        other = reconstructed(reordered(scan, order), uncertainty=0)
        error = relative_error(other.volume, first.volume)
        changed.append(("reversed" if not number else f"permuted {number}", error))
        faults += [f"{', '.join(one) or 'none'} instead of {', '.join(own) or 'none'}"
                   for own, one in [(named(first), named(other))] if own != one]  # fmt: skip
    over = f"12 views, {len(orders)} orders, {NOISE:.0%} noise"
    stress = f"{name}: volume with the cameras in another order"
    yield Row.of_worst(stress, over, changed, ROUNDING, "of its norm")
    yield Row.of_faults(
        f"{name}: other cameras named in another order", over, faults, ", ".join(named(first))
    )


def reordered(scan: Scan, order: list[str]) -> Scan:
    """Return the scan with its cameras in that order."""
    return replace(scan, rig=Rig(tuple(scan.rig[scan.rig.names.index(one)] for one in order)))


def named(found: Reconstruction) -> list[str]:
    """Return the cameras that findings are of, with the effect, sorted."""
    return sorted({f"{one.camera}: {one.effect}" for one in found.findings if one.camera})
