"""Progress of a series: stages of planning and frames differ by how a step begins."""

from __future__ import annotations

from collections.abc import Callable

from tomo.operators.system import Progress

PLANNING = "plan: "
"""How the steps of planning begin."""


def planning(progress: Progress | None) -> Callable[[str], Progress | None]:
    """Return a function that begins a stage of planning by name, and gives its progress.

    Examples
    --------
    >>> stage = planning(lambda done, total, where: print(done, total, where))
    >>> tell = stage("tracing")
    0 0 plan: tracing
    >>> tell(1, 5, "cam01")
    1 5 plan: tracing: cam01
    """

    def begin(name: str) -> Progress | None:
        if progress is None:
            return None
        progress(0, 0, f"{PLANNING}{name}")

        def tell(done: int, total: int, where: str) -> None:
            progress(done, total, f"{PLANNING}{name}: {where}")

        return tell

    return begin


def stage_of(step: str) -> tuple[str, str]:
    """Return the stage of planning that a step belongs to, empty for frames, and the rest.

    Examples
    --------
    >>> stage_of("plan: tracing: cam01")
    ('tracing', 'cam01')
    >>> stage_of("frame 7")
    ('', 'frame 7')
    """
    if not step.startswith(PLANNING):
        return "", step
    stage, _, rest = step.removeprefix(PLANNING).partition(": ")
    return stage, rest
