"""What may be asked of a reconstruction: each check names the argument, one line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real

from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, VOXEL
from tomo.pipeline.methods import AUTO, Method, method_named, method_names
from tomo.pipeline.reconstruction import UNSEEN
from tomo.scan import Scan
from tomo.selection.basis import BASES
from tomo.selfcal.refine.search import FEWEST
from tomo.uncertainty import AUTO_REPEATS


def compared_with(asked: Sequence[tuple[str, int | None]]) -> list[tuple[Method, int | None]]:
    """Return the methods to run beside another, and their iterations; ``auto`` is none."""
    known = [one for one in method_names() if one != AUTO]
    found = []
    for one in asked:
        if isinstance(one, str) or len(one) != 2:
            raise ValueError(
                f"compare: found {one!r}, expected method and iterations, like ('sirt', 100), "
                "or None for its own"
            )
        name, iterations = one
        if name not in known:
            raise ValueError(f"compare: found {name!r}, expected one of {', '.join(known)}")
        found.append((method_named(name), iterations))
    return found


def check_numbers(seed: int, time_limit: float | None) -> None:
    """Refuse a seed or a time limit out of range."""
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed: found {seed}, expected a whole number from 0 to 2^63 - 1")
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit: found {time_limit}, expected seconds above 0")


def repeats_of(uncertainty: int | str, method: Method) -> int:
    """Return how often to repeat the solve with new noise; ``auto``: a few for ``auto`` alone.

    Choosing has cost ``auto`` more than that; another method may run for hours.
    """
    if uncertainty == AUTO:
        return AUTO_REPEATS if method.name == AUTO else 0
    if isinstance(uncertainty, str) or uncertainty % 1 or uncertainty < 0 or uncertainty == 1:
        raise ValueError(
            f"uncertainty: found {uncertainty!r}, expected auto, 0, or 2 repeats or more"
        )
    if uncertainty and method.needs_midpoints:
        raise ValueError(
            f"uncertainty: found {uncertainty} repeats, expected 0 or auto for method "
            f"{method.name}: what is learned is not repeated"
        )
    return int(uncertainty)


def blur_of(blur: float | str, methods: Sequence[Method]) -> float | None:
    """Return the diameter of the discs that images are blurred by; None: to be found in them."""
    if blur != AUTO and (isinstance(blur, str) or not (math.isfinite(blur) and blur >= 0)):
        raise ValueError(f"blur: found {blur!r}, expected auto or a diameter >= 0")
    by_lines = [one.name for one in methods if not one.through_lenses]
    if blur and by_lines:
        raise ValueError(
            f"blur: found {blur}, expected 0 for method {by_lines[0]}: it goes line by line"
        )
    return None if blur == AUTO else float(blur)


def check_basis(basis: str, blur: float | str, method: Method) -> None:
    """Refuse an unknown basis, and splines where there can be none."""
    if basis not in (AUTO, *BASES):
        expected = ", ".join((AUTO, *BASES))
        raise ValueError(f"basis: found {basis!r}, expected one of {expected}")
    if basis == LINEAR and not method.through_lenses:
        raise ValueError(
            f"basis: found {basis}, expected {VOXEL} for method {method.name}: it goes line by "
            "line"
        )
    if basis == LINEAR and blur:
        raise ValueError(
            f"basis: found {basis} with blur {blur}, expected {VOXEL}: discs are told for those"
        )


def check_carving(
    *, skip: bool, margin: float | str, dark_level: float | str, votes: int | str, views: int
) -> None:
    """Refuse what nothing can be carved by, and to say how to carve where nothing is carved."""
    if not skip:
        for name, value in (("margin", margin), ("dark_level", dark_level), ("votes", votes)):
            if value != AUTO:
                raise ValueError(
                    f"{name}: found {value} with nothing to leave out (skip is False), "
                    "expected auto"
                )
    if votes != AUTO and not (isinstance(votes, Integral) and 1 <= votes <= views):
        raise ValueError(
            f"votes: found {votes!r}, expected auto or a whole number from 1 to {views}, the "
            "cameras to reconstruct from"
        )
    is_number = isinstance(dark_level, Real) and math.isfinite(dark_level)
    if dark_level != AUTO and not (is_number and dark_level >= 0):
        raise ValueError(f"dark_level: found {dark_level!r}, expected auto or a number >= 0")


def check_unseen(unseen: str) -> None:
    """Refuse anything but the names of `tomo.pipeline.reconstruction.UNSEEN`."""
    if unseen not in UNSEEN:
        raise ValueError(f"unseen: found {unseen!r}, expected one of {', '.join(UNSEEN)}")


def check_grid(grid: VoxelGrid | None, scan: Scan) -> None:
    """Refuse to reconstruct without a grid."""
    if grid is None:
        raise ValueError(
            f"{scan.source}: grid: found none in the scan or its rig, expected one: "
            "--grid with --spacing, or with --lower and --upper"
        )


def check_device(device: str, methods: Sequence[Method]) -> None:
    """Refuse a device that none of the methods runs on, or that is not there."""
    if device == "cpu":
        return
    if not any(method.takes("device") for method in methods):
        raise ValueError(
            f"device: found {device!r}, expected cpu for method {methods[0].name}: "
            "only wernet and wernet-paper run on others"
        )
    from tomo.wernet import usable_device

    usable_device(device)


def check_learning(method: Method, asked: Mapping[str, object]) -> None:
    """Refuse arguments about what is learnt for a method that learns nothing of the kind."""
    for name, value in asked.items():
        if value and not method.takes(name):
            able = [one for one in method_names() if method_named(one).takes(name)]
            raise ValueError(
                f"{name}: found {value!s}, expected none for method {method.name}: "
                f"only {' and '.join(able)} can use it"
            )


def cameras_to_refine(
    names: Sequence[str] | None, prior: float | None, hold_out: Sequence[str], scan: Scan
) -> tuple[str, ...]:
    """Return the cameras to refine: those asked for that are not held out; none for None."""
    if prior is not None and not (names is not None and math.isfinite(prior) and prior > 0):
        expected = "none without cameras to refine" if names is None else "pixels above 0"
        raise ValueError(f"refine_prior: found {prior:g}, expected {expected}")
    if names is None:
        return ()
    for name in names:
        if name not in scan.rig.names:
            raise ValueError(
                f"{scan.source}: refine_cameras: found camera {name!r}, "
                f"expected one of {', '.join(scan.rig.names)}"
            )
    left = tuple(name for name in names if name not in hold_out)
    if not left:
        found = f"only cameras held out: {', '.join(names)}" if names else "no camera"
        raise ValueError(
            f"{scan.source}: refine_cameras: found {found}, expected one to reconstruct from"
        )
    views = len(scan.rig) - len(set(hold_out))
    if views < FEWEST:
        raise ValueError(
            f"{scan.source}: refine_cameras: found {views} views to refine with, expected at "
            f"least {FEWEST}"
        )
    return left


def check_hold_out(hold_out: Sequence[str], scan: Scan) -> None:
    """Refuse to hold out cameras that are not there, or all of them."""
    names = scan.rig.names
    for name in hold_out:
        if name not in names:
            raise ValueError(
                f"{scan.source}: hold_out: found camera {name!r}, "
                f"expected one of {', '.join(names)}"
            )
    if set(hold_out) == set(names):
        raise ValueError(
            f"{scan.source}: hold_out: found all {len(names)} cameras, expected at least one "
            "left to reconstruct from"
        )
