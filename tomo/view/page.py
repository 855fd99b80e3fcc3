"""The viewer's page, and what it asks for while it is open, made of some content."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.draw.page import render, script_safe
from tomo.draw.rig.rig_scene import Target, rig_scene
from tomo.draw.rig.thumbnails import image_scene, load_thumbnails, symbol_values
from tomo.draw.scene import Scene
from tomo.draw.stage import HIDDEN_AT_FIRST, Shown, fitting, in_steps, scale_of, stage
from tomo.grid import Volume
from tomo.operators import LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.pipeline.evaluate import views_of
from tomo.pipeline.view import View
from tomo.report.pictures import view_pictures
from tomo.view.content import Content

HIDDEN = (*HIDDEN_AT_FIRST, "sight lines", "names", "arrows")
"""Groups that would stand before a volume's light."""


class Page:
    """A content as the page shows it; it raises if the first frame cannot be read."""

    def __init__(self, content: Content) -> None:
        self.content = content
        self._highest = 1.0
        self.html = self._html()

    def __repr__(self) -> str:
        return f"<Page of {self.content.title!r}: {len(self.html)} letters>"

    def volume(self, place: int) -> NDArray[np.uint8]:
        """Return a frame's volume in steps of the page's scale, ``(nx, ny, nz)``."""
        return in_steps(fitting(self._frame(place)), self._highest)

    def images(self, place: int) -> NDArray[np.uint8]:
        """Return the numbers of the pictures in the cameras' symbols, in the scene's order."""
        pictures = self._pictures(place)
        return np.concatenate([symbol_values(one) for one in pictures.values()])

    def compared(self, place: int, camera: int) -> dict[str, Any]:
        """Return one camera's images as PNGs, and their figures in words."""
        content = self.content
        if content.scan is None:
            raise ValueError("camera: found no scan, expected one to have images")
        view = compare(content, content.scan.rig.names[camera], place)
        three = view_pictures([view])
        assert three is not None  # there is a view
        words, images = three["shown"]["words"], three["shown"]["images"]
        if content.frames is None:
            return {"words": view.name, "images": images[:1]}
        recorded = content.residual(view.name, place) if content.residual else None
        if recorded is not None:
            words += f"\nResidual in the reconstruction's record: {recorded:.1%}."
        words += f"\nMeasured over re-projected light: {view.light:.4g}."
        limit = three["limit"]
        words += f"\nDifference in percent of the largest value: blue −{limit}, red +{limit}."
        return {"words": words, "images": images}

    def _frame(self, place: int) -> Volume:
        content = self.content
        assert content.frames is not None  # pages without volumes ask for none
        assert content.grid is not None
        data = content.frames.volume(place)
        return Volume(data, content.grid, content.length_unit, content.value_unit)

    def _pictures(self, place: int) -> dict[str, NDArray[np.uint8]]:
        scan = self.content.scan
        assert scan is not None  # pages without images ask for none
        return load_thumbnails(scan.rig, scan, self.content.moments[place])

    def _html(self) -> str:
        content, shown = self.content, self._shown()
        scene = Scene(length_unit=content.length_unit)
        if content.rig is not None:
            scene = rig_scene(content.rig, content.box, up=content.up).without("stems")
        if content.scan is not None:
            target = Target.of(content.scan.rig, content.box)
            scene += image_scene(content.scan.rig, target, self._pictures(0))
        cameras = list(content.scan.rig.names) if content.scan else []
        known = [content.residual(name, 0) if content.residual else None for name in cameras]
        drawn = stage(
            scene,
            up=content.up,
            grid=content.box,
            shown=shown,
            moments=[(name, 0.0) for name in content.names],
            visible=["images"],
            hidden=HIDDEN if shown else HIDDEN_AT_FIRST,
            close_up=shown is not None,
            note=" ".join(f"{note.rstrip('.')}." for note in self._notes()),
        )
        return render(
            "live.html",
            title=content.title,
            stage=drawn,
            live=script_safe(json.dumps({"cameras": cameras})),
            compared=cameras
            and {
                "first": int(np.argmax([one or 0.0 for one in known])),
                "last": len(cameras) - 1,
                "shown": {"words": "", "images": []},
                "data": script_safe(json.dumps([{"words": name} for name in cameras])),
            },
        )

    def _shown(self) -> Shown | None:
        """Return the first volume on the scale of the film."""
        content = self.content
        if content.frames is None:
            return None
        first, others = self._frame(0), content.frames.spread()[:-1]
        small = fitting(first)
        scale = scale_of([small, *(fitting(self._frame(k)) for k in others)], content.up)
        self._highest = scale[0]
        return Shown((small,), up=content.up, whole=first.grid, scale=scale)

    def _notes(self) -> list[str]:
        content, notes = self.content, []
        if content.grid is not None and content.frames is not None:
            shape = " x ".join(map(str, content.grid.shape))
            unit = f" {content.value_unit}" if content.value_unit else ""
            notes.append(f"{shape} voxels, 100 % is {self._highest:.4g}{unit}")
        elif content.rig is not None:
            notes.append(f"{len(content.rig)} cameras")
        return [*notes, *content.notes]


def compare(content: Content, camera: str, place: int) -> View:
    """Return a camera's image of a moment beside the line integrals of the volume.

    The content's model holds the basis, gains and backgrounds of the volume; without a volume the
    re-projected image is dark. One ray goes through each pixel's middle. Blur, absorption and
    learned weights of a reconstruction are not applied: see the residual on record.
    """
    assert content.scan is not None  # contents without one offer no camera to compare
    own = content.scan.only(camera)
    images, masks = own.read(content.moments[place])
    dark = View(camera, images[0], np.zeros_like(images[0]), masks[0])
    if content.frames is None:
        return dark
    try:
        system = LinearSystem.from_rig(own.rig, content.grid, masks=masks, form="on-the-fly")
    except VolumeNotSeenError:
        return dark
    if content.model.is_linear:
        system = system.with_linear_basis().on_voxel_means
    gains = content.model.gains_of(camera)
    return views_of(system, content.frames.volume(place), images, masks, gains)[0]
