"""Images that are not where they belong: another camera's, mirrored, or turned by half."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tomo.measurement import estimate_noise
from tomo.pipeline.view import View
from tomo.screening import find_exchanged, find_turned_over


@dataclass(frozen=True)
class Misplaced:
    """Images that make all others agree once they are put right.

    Attributes
    ----------
    cameras : tuple of str
        The camera, or the two cameras.
    reason : str
        What is wrong, in words that fit after "likely causes:".
    needs : str
        What to do.
    left : float
        Squared error that is left with the images put right, over that as they are.
    held_out : bool
        Whether the camera took no part.
    """

    cameras: tuple[str, ...]
    reason: str
    needs: str
    left: float
    held_out: bool = False

    @property
    def cause(self) -> str:
        """The reason with what is left and what to do, as a phrase."""
        whose = "its" if self.held_out else "all images'"
        return f"{self.reason} (put right, {self.left:.0%} of {whose} squared error is left)"

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``misplaced``."""
        return {
            "cameras": list(self.cameras),
            "reason": self.reason,
            "needs": self.needs,
            "left": self.left,
            "held_out": self.held_out,
        }


def find_misplaced(outcome: Any) -> Misplaced | None:
    """Return whose images are not where they belong, the likeliest; None for none.

    Parameters
    ----------
    outcome : tomo.Reconstruction
        Its images are compared once more, as they are and put right.
    """
    known = (outcome.screening or {}).get("cameras") or {}
    names = outcome.rig.names
    used = [view for view in outcome.views if view.takes_part and view.name in names]
    held = [view for view in outcome.views if view.held_out and view.name not in known]
    held = [view for view in held if view.name in names]
    turned = find_turned_over(*_seen(outcome, [*used, *held]), trusted=len(used))
    swapped = find_exchanged(*_seen(outcome, used))
    found = []
    if turned is not None:
        own = turned.camera in {view.name for view in held}
        reason = f"camera {turned.camera}'s images are {turned.words}"
        found.append(Misplaced((turned.camera,), reason, turned.needs, turned.left, own))
    if swapped is not None:
        both = " and ".join(swapped.cameras)
        reason = f"cameras {both} have each other's images"
        needs = "exchange their folders of images"
        found.append(Misplaced(swapped.cameras, reason, needs, swapped.left))
    return min(found, key=lambda one: one.left, default=None)


def _seen(outcome: Any, views: Sequence[View]) -> tuple[Any, ...]:
    """Return rig, images, masks, grid and noise of some views."""
    return (
        replace(outcome.rig, cameras=tuple(outcome.rig[view.name] for view in views)),
        [view.measured for view in views],
        [view.usable for view in views],
        outcome.solution.grid,
        [estimate_noise(view.measured, view.usable) for view in views],
    )
