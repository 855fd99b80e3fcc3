"""One camera's measured image beside the image of the volume, and the numbers of the two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import ColourScale
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, Gains, LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.pipeline.evaluate import views_of
from tomo.pipeline.view import View
from tomo.scan import Scan
from tomo.view.colours import beside_each_other, painted


@dataclass(frozen=True)
class Model:
    """How a reconstruction said that images come from its volume.

    Attributes
    ----------
    is_linear : bool
        Whether emission is linear between the centres of voxels, rather than constant in each.
    gain, offset : mapping
        Camera to the gain and the background of its images; 1 and 0 where none is known.
    """

    is_linear: bool = False
    gain: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, basis: Mapping[str, Any] | None, gains: Mapping[str, Any] | None) -> Model:
        """Return the model of a report's ``basis`` and ``gains``."""
        known = gains or {}
        is_linear = (basis or {}).get("name") == LINEAR
        return cls(is_linear, known.get("gain") or {}, known.get("offset") or {})

    def gains_of(self, camera: str) -> Gains | None:
        """Return the gain and the background of one camera; None where none are known."""
        if camera not in self.gain:
            return None
        known = Gains.none(1)
        gain, offset = self.gain[camera], self.offset.get(camera, 0.0)
        return replace(known, gain=np.array([float(gain)]), offset=np.array([float(offset)]))


@dataclass(frozen=True, eq=False)
class Comparison:
    """A camera's measured image, beside that of the volume where there is one.

    Attributes
    ----------
    name : str
        The camera's.
    measured : (rows, columns) float32
    view : View, optional
        With the re-projected image.
    recorded : float, optional
        The relative residual on record, with whatever the reconstruction corrected.
    """

    name: str
    measured: NDArray[np.float32]
    view: View | None = None
    recorded: float | None = None

    @cached_property
    def brightest(self) -> float:
        """The measured image's value without its brightest 0.1 %, which is shown as the last."""
        bright = float(np.quantile(self.measured, 0.999))
        return bright if bright > 0 else float(self.measured.max(initial=0.0)) or 1.0

    @cached_property
    def difference(self) -> NDArray[np.float32] | None:
        """Measured less re-projected, 0 where not usable."""
        if self.view is None:
            return None
        found = np.where(self.view.usable, self.measured - self.view.reprojected, 0)
        return np.nan_to_num(found).astype(np.float32)

    def picture(self, colours: str) -> NDArray[np.uint8]:
        """Return the images in colours, in a row: measured, re-projected, difference."""
        scale = ColourScale("", 0.0, self.brightest, colours)
        pictures, headings = [painted(self.measured, scale)], ["measured"]
        if self.view is not None and self.difference is not None:
            most = self.largest_difference
            pictures += [
                painted(self.view.reprojected, scale),
                painted(self.difference, ColourScale("", -most, most, "RdBu_r")),
            ]
            headings += ["re-projected", "difference"]
        return beside_each_other(pictures, headings)

    @property
    def largest_difference(self) -> float:
        """The end of the colours of the difference: 99.9 % of the pixels are within."""
        if self.difference is None:
            return 1e-30
        return float(np.quantile(np.abs(self.difference), 0.999)) or 1e-30

    def words(self) -> str:
        """Return the numbers in Markdown."""
        rows, columns = self.measured.shape
        lines = [f"**{self.name}**, {columns} x {rows} pixels; colours 0 to {self.brightest:.3g}"]
        if self.view is not None:
            lines.append(f"difference: blue {-self.largest_difference:.2g}, red "
                         f"{self.largest_difference:.2g}")  # fmt: skip
            lines.append(f"relative residual {_percent(self.view.relative_residual)}")
            if self.recorded is not None:
                lines.append(f"in the reconstruction's record {_percent(self.recorded)}")
            lines.append(f"measured over re-projected light {self.view.light:.4g}")
        return "  \n".join(lines)


def compare(
    scan: Scan,
    moment: str,
    camera: str,
    volume: NDArray[np.float32] | None = None,
    grid: VoxelGrid | None = None,
    model: Model = Model(),
    recorded: float | None = None,
) -> Comparison:
    """Return a camera's image of a moment beside the line integrals of a volume.

    Parameters
    ----------
    scan : Scan
        Its rig is that of the volume.
    moment : str
        The frame's name.
    camera : str
    volume : (nx, ny, nz) float32, optional
    grid : VoxelGrid, optional
    model : Model
        The basis, gains and backgrounds of the volume.
    recorded : float, optional
        The relative residual on record.

    Notes
    -----
    One ray goes through each pixel's middle. Blur, absorption and learned weights of a
    reconstruction are not applied: see the residual on record.
    """
    own = scan.only(camera)
    images, masks = own.read(moment)
    if volume is None:
        return Comparison(camera, images[0], None, recorded)
    try:
        system = LinearSystem.from_rig(own.rig, grid, masks=masks, form="on-the-fly")
    except VolumeNotSeenError:
        dark = np.zeros_like(images[0])
        return Comparison(camera, images[0], View(camera, images[0], dark, masks[0]), recorded)
    if model.is_linear:
        system = system.with_linear_basis().on_voxel_means
    view = views_of(system, volume, images, masks, model.gains_of(camera))[0]
    return Comparison(camera, images[0], view, recorded)


def _percent(ratio: float) -> str:
    return f"{100 * ratio:.3g} %" if np.isfinite(ratio) else "unknown: the image is dark"
