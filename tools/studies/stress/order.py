"""Cameras in another order: the same volume within rounding, and the same cameras named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rigs import Rig
from studies.common.scans import reconstructed
from studies.common.study import Request, Tables
from studies.stress.calibration_scene import Flame, noisier, simulated
from studies.stress.row import COLUMNS, Row, measured, relative_error, worst_of
from tomo import Scan
from tomo.pipeline import Reconstruction

__all__ = ["COLUMNS", "run"]

NOISE = 0.02
ORDERS, QUICK_ORDERS = 3, 1
ROUNDING = 1e-4
"""Part of the volume's norm: sums in another order, in float32, through some thirty solves."""

WRONG = 3


def run(request: Request) -> Tables:
    """Measure the rows of this part."""
    return measured(_rows(request))


def _rows(request: Request) -> Iterator[Row]:
    count = QUICK_ORDERS if request.size != "full" else ORDERS
    scans = wrong_scans(Flame.seen(noisier(simulated(request.seed), NOISE, request.seed)))
    random = np.random.default_rng(request.seed)
    for number, (name, scan) in enumerate(scans.items()):
        request.progress(number, len(scans), name)
        orders = [random.permutation(len(scan.rig)) for _ in range(count)]
        yield from order_rows(name, scan, [list(scan.rig.names[::-1]), *(
            [scan.rig.names[n] for n in order] for order in orders
        )])  # fmt: skip
    request.progress(len(scans), len(scans), "")


def wrong_scans(flame: Flame) -> dict[str, Scan]:
    """Return the scan as it is, and with one camera that is wrong."""
    scan, name = flame.scan, flame.rig.names[WRONG]
    images = dict(zip(scan.rig.names, scan.read()[0], strict=True))
    own = images[name]
    changed = {"darker by a fifth": own * np.float32(0.8), "mirrored": own[:, ::-1]}
    return {
        "as it is": scan,
        "a camera 2 px off": flame.one_off(WRONG, 2.0),
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
    worst, where = worst_of(changed)
    yield Row(f"{name}: volume with the cameras in another order", over, worst, ROUNDING,
              "of its norm", note=where)  # fmt: skip
    yield Row.of_faults(
        f"{name}: other cameras named in another order", over, faults, ", ".join(named(first))
    )


def reordered(scan: Scan, order: list[str]) -> Scan:
    """Return the scan with its cameras in that order."""
    return replace(scan, rig=Rig(tuple(scan.rig[scan.rig.names.index(one)] for one in order)))


def named(found: Reconstruction) -> list[str]:
    """Return the cameras that findings are of, with the effect, sorted."""
    return sorted({f"{one.camera}: {one.effect}" for one in found.findings if one.camera})
