"""What is written and said of a reconstruction before it is whole: preview, volume, pictures."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
from pathlib import Path
from typing import Any

from rigs.files.text import write_json
from rigs.progress import Progress
from tomo.draw.figures import png_bytes
from tomo.pipeline import Reconstruction
from tomo.pipeline.reconstruct import PREVIEW, VOLUME
from tomo.report.artist import Artist
from tomo.report.outcome_files import (
    PREVIEW_FILES,
    VOLUME_FILES,
    Drawn,
    drawn,
    write_outcome,
    write_volumes,
    write_with_units,
)
from tomo.report.pictures import Picture, write_pictures

_FIGURES = ("matplotlib.backends.backend_agg", "tomo.draw.volume.visualize")
_SCENES = ("tomo.draw.rig.visualize", "tomo.draw.writers", "tomo.report.pictures")
"""Modules that take long to load: those that figures need, and those that scenes need beside."""


class Ahead:
    """Writes into a folder what `tomo.reconstruct` gives ``early``, and says so.

    ``say`` is called with lines, from any thread, ``keep`` with words on what an interrupted run
    leaves. No pictures are drawn without an ``artist``.
    """

    def __init__(
        self,
        folder: str | os.PathLike,
        say: Callable[[str], None],
        artist: Artist | None = None,
        keep: Callable[[str], None] = lambda words: None,
    ) -> None:
        self.folder, self.say, self.artist, self.keep = Path(folder), say, artist, keep
        self._first: Future[Drawn] | None = None
        if artist:
            artist.ask(_load, *_FIGURES)

    def __call__(self, step: str, outcome: Reconstruction) -> None:
        """Write what is known at one of the steps ``preview``, ``volume`` and ``images``."""
        if step == PREVIEW:
            self.preview(outcome)
        elif step == VOLUME:
            write_volumes(self.folder, outcome)
            self._complete(VOLUME_FILES[0], outcome, "without intervals and report")
        elif self.artist:
            self._first = self.artist.ask(drawn, outcome)

    def preview(self, outcome: Reconstruction) -> Future[Picture] | None:
        """Write and say a preview; return what its picture is waited for by, if one is drawn."""
        volume, figures, _ = (self.folder / name for name in PREVIEW_FILES)
        write_with_units(volume, outcome.volume, allow_nan=True)
        write_json(figures, outcome.report(), indent=2)
        self.say(outcome.answer.sentence)
        self._complete(volume.name, outcome, "a preview")
        if self.artist is None:
            return None

        def write(found: Picture) -> None:
            (path,) = write_pictures(self.folder, [found])
            self.say(f"open {path}")

        asked = self.artist.ask(_preview_picture, outcome, then=write)
        self.artist.ask(_load, *_SCENES)
        return asked

    def save(
        self, outcome: Reconstruction, command: str, progress: Progress | None = None
    ) -> dict[str, Any]:
        """Write the rest, as `Reconstruction.save` does; return what is in ``report.json``."""
        tell = progress or (lambda done, total, where: None)
        if self.artist is None or self._first is None:
            return write_outcome(self.folder, outcome, with_pictures=False, command=command)
        tell(0, 3, "drawn beside the intervals")
        first = self._first.result()
        tell(1, 3, "intervals")
        done = [one.name for one in first.pictures]
        last = self.artist.ask(drawn, outcome, (*done, *first.pages)).result()
        tell(2, 3, "report")
        return write_outcome(self.folder, outcome, command=command, known=first + last)

    def _complete(self, name: str, outcome: Reconstruction, what: str) -> None:
        shape = " x ".join(map(str, outcome.solution.grid.shape))
        self.keep(f"{self.folder / name} is complete, {what}")
        self.say(
            f"{name} is complete after {outcome.seconds['total']:.1f} s: {shape} voxels, relative "
            f"residual {outcome.solution.relative_residual:.2%}"
        )


def _load(*modules: str) -> None:
    for name in modules:
        import_module(name)


def _preview_picture(outcome: Reconstruction) -> Picture:
    """Return the picture of a preview's volume."""
    from tomo.draw.volume.visualize import draw_volume
    from tomo.report.result_figures import seen_volume

    png = png_bytes(draw_volume(seen_volume(outcome), title="Preview"))
    return Picture(PREVIEW, png, "A preview", "Light and planes of a coarse volume")
