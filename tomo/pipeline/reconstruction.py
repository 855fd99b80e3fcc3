"""The result of a reconstruction: the volume, and everything that its report needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo._compute.higher import higher
from tomo.grid import Volume
from tomo.inference.finding import Finding
from tomo.io import data_array
from tomo.pipeline.answer import Answer, answer_of
from tomo.pipeline.options import Options
from tomo.pipeline.report_json import report_of
from tomo.pipeline.verdict import Verdict, judge
from tomo.pipeline.view import Peak, View
from tomo.solvers import Solution

if TYPE_CHECKING:
    from os import PathLike

    from xarray import DataArray

    from tomo.pipeline.learned_weights import LearnedWeights
    from tomo.uncertainty import Assessment


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A reconstruction with everything that its report needs.

    Attributes
    ----------
    solution : Solution
    rig : Rig
        All cameras, the held-out ones too.
    views : tuple of View
        One a camera, in the rig's order.
    peak : Peak
        For PSNR and SSIM.
    truth : (nx, ny, nz) float32, optional
    comparisons : tuple of Solution
        Further methods' solutions from the same images.
    compared : tuple of mappings
        For each of these, by held-out camera: see `tomo.pipeline.view.View.held_out_figures`.
    counts : mapping
        ``rays, segments, voxels, active_voxels``.
    carving : mapping
        Pixels and voxels left out of the system, see `tomo.hull.Carving.report`.
    screening : mapping, optional
        What single images show, see `tomo.measurement.pixel_check.PixelCheck.report`, and the
        cameras that were ``excluded``; None where it was not looked for.
    findings : tuple of Finding
        What is wrong with cameras and gas, the gravest first.
    detection_limits : mapping, optional
        The smallest faults that the images would tell, see `tomo.pipeline.limits.Limits.report`.
    depth_of_field : mapping, optional
        How it was modelled, see `tomo.pipeline.assemble`; None where lenses were pinholes.
    refinement, gains : mapping, optional
        See `tomo.pipeline.refine.Refinement.report` and `tomo.operators.view_gains.Gains.report`;
        None where they were not looked for, or the gains not corrected.
    refined_rig : Rig, optional
        All cameras, those refined and shifted as they were found, at the size that images were
        recorded in; None where that was not asked for, or found nothing.
    seconds : mapping
        A stage each, ``load, screen, register, trace, build, solve, compare, evaluate,
        uncertainty``, and ``total``; ``choose`` is a part of ``solve``.
    first_use_seconds : float
        Compiling or loading kernels, once a process.
    unseen : (nx, ny, nz) bool, optional
        True where no usable ray of any camera crosses the voxel.
    warnings : tuple of str
        One line each; worth reading before the volume is trusted.
    options : Options
        The options asked for.
    scan : mapping
        ``frame, scale, value_unit, grid``: the frame's name, by how much images were shrunk, the
        unit of the volume's values, the voxels.
    projector, basis, pixel_weights : mapping
        The form of the projector, the unknowns and the pixels' weights that were used, and why.
    learned : LearnedWeights, optional
        The weights learned in place of segment lengths; None: none were.
    uncertainty : Assessment, optional
        How far the volume is to be trusted, see `tomo.uncertainty`.
    preview : int, optional
        How many times as wide as asked pixels and voxels are, where this is `tomo.preview`'s.
    """

    solution: Solution
    rig: Rig
    views: tuple[View, ...]
    peak: Peak
    truth: NDArray[np.float32] | None = None
    comparisons: tuple[Solution, ...] = ()
    compared: tuple[Mapping[str, Mapping[str, Any]], ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    carving: Mapping[str, Any] = field(default_factory=dict)
    screening: Mapping[str, Any] | None = None
    findings: tuple[Finding, ...] = ()
    detection_limits: Mapping[str, Any] | None = None
    depth_of_field: Mapping[str, Any] | None = None
    refinement: Mapping[str, Any] | None = None
    refined_rig: Rig | None = None
    gains: Mapping[str, Any] | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    first_use_seconds: float = 0.0
    unseen: NDArray[np.bool_] | None = None
    warnings: tuple[str, ...] = ()
    options: Options = Options()
    scan: Mapping[str, Any] = field(default_factory=dict)
    projector: Mapping[str, Any] = field(default_factory=dict)
    basis: Mapping[str, Any] = field(default_factory=dict)
    pixel_weights: Mapping[str, Any] = field(default_factory=dict)
    learned: LearnedWeights | None = None
    uncertainty: Assessment | None = None
    preview: int | None = None

    def __repr__(self) -> str:
        """Return four lines: the method, the voxels, the answer, where the rest is."""
        method = self.solution.settings.get("method", "unknown method")
        return (
            f"<Reconstruction: {method}, frame {self.scan.get('frame', 'unknown')}, "
            f"{len(self.rig)} cameras\n"
            f"  volume: {self.solution.grid!r}, {self.value_unit or 'unit unknown'}\n"
            f"  relative residual {self.solution.relative_residual:.3g}, "
            f"warnings: {len(self.warnings)}\n"
            "  .answer, .verdict and .report() say more; .save(folder) writes all>"
        )

    @property
    def volume(self) -> Volume:
        """The volume; zero where no ray says anything, see ``unseen``."""
        return Volume(
            self.solution.volume, self.solution.grid, self.rig.length_unit, self.value_unit
        )

    @cached_property
    def answer(self) -> Answer:
        """Whether the volume explains the images."""
        return answer_of(self)

    @cached_property
    def verdict(self) -> Verdict:
        """How far to trust the volume: ``level`` (green, amber, red), ``reasons``, ``next``."""
        return judge(self.report())

    @property
    def value_unit(self) -> str:
        """The unit of the volume's values, such as ``full scales per mm``; empty if unknown."""
        return self.scan.get("value_unit", "")

    @property
    def half_width(self) -> NDArray[np.float32] | None:
        """The half-width of every voxel's 90 % interval; None where that is not known."""
        return self.uncertainty.half_width if self.uncertainty else None

    @property
    def standard_deviation(self) -> NDArray[np.float32] | None:
        """What noise leaves in every voxel; None where single voxels' are not known."""
        found = self.uncertainty
        return found.standard_deviation if found is not None and found.mapped else None

    def to_xarray(self) -> DataArray:
        """Return the volume with coordinates and units, as an `xarray.DataArray`.

        ``half_width`` and ``standard_deviation`` are coordinates along x, y and z where they are
        known, so that they are cut as the volume is; ``.reset_coords()`` makes a Dataset of all.
        `tomo.VoxelGrid.from_xarray` gives the grid back.
        """
        known = {"half_width": self.half_width, "standard_deviation": self.standard_deviation}
        return data_array(
            self.volume,
            self.solution.grid,
            self.rig.length_unit,
            self.value_unit,
            more={name: values for name, values in known.items() if values is not None},
            long_name="mean emission of a voxel",
            method=str(self.solution.settings.get("method", "")),
            frame=str(self.scan.get("frame", "")),
        )

    def save(
        self, folder: str | PathLike, *, with_pictures: bool = True, command: str = ""
    ) -> dict[str, Any]:
        """Write what ``flametomo reconstruct`` writes: volumes, pictures and report.

        Parameters
        ----------
        folder : path-like
        with_pictures : bool
            Whether pictures are drawn; without, the page has none.
        command : str
            What was typed to get it; the page names it.

        Returns
        -------
        report : dict
            The contents of ``report.json``.
        """
        return higher("save")(folder, self, with_pictures=with_pictures, command=command)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return higher("reconstruction_html")(self)

    def report(self) -> dict[str, Any]:
        """Return the contents of ``report.json``: plain numbers, strings, lists and mappings."""
        return report_of(self)
