"""What a whole reconstruction gives back: volume, views, comparisons, and the report's figures."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo import metrics
from tomo._compute.reductions import dot, norm
from tomo.pipeline.options import NOT_A_NUMBER, Options
from tomo.solvers import Solution

if TYPE_CHECKING:
    from tomo.uncertainty import Assessment
    from tomo.wernet.default import LearnedWeights

_REPORTED_PACKAGES = ("flametomo", "numpy", "scipy", "numba", "torch", "open3d", "open3d-cpu")


@dataclass(frozen=True, eq=False)
class View:
    """One camera's image beside its re-projection.

    Attributes
    ----------
    name : str
        The camera's.
    measured, reprojected : (rows, columns) float32
        In one unit.
    mask : (rows, columns) bool, optional
        True where a pixel is usable.
    held_out : bool
        Whether the reconstruction never saw this view, as was asked for.
    left_out : bool
        Whether it never saw this view because the others contradict it.
    """

    name: str
    measured: NDArray
    reprojected: NDArray
    mask: NDArray | None = None
    held_out: bool = False
    left_out: bool = False

    def __post_init__(self) -> None:
        """Check that the images fit on each other."""
        for name in ("reprojected", "mask"):
            other = getattr(self, name)
            if other is not None and other.shape != self.measured.shape:
                raise ValueError(
                    f"view {self.name}: {name}: found shape {other.shape}, expected the "
                    f"measured image's {self.measured.shape}"
                )

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which pixels count, ``(rows, columns)``."""
        finite = np.isfinite(self.measured) & np.isfinite(self.reprojected)
        return finite if self.mask is None else finite & self.mask

    @property
    def relative_residual(self) -> float:
        """``||measured - reprojected|| / ||measured||`` of usable pixels; NaN if all are dark."""
        measured, reprojected = self._usable_pixels()
        size = norm(measured)
        return norm(measured - reprojected) / size if size > 0 else math.nan

    @property
    def gain(self) -> float:
        """The factor on the re-projection that fits the measured image best; NaN if it is dark.

        A view that differs from 1 by more than the others was brighter or darker than they say.
        """
        measured, reprojected = self._usable_pixels()
        energy = dot(reprojected, reprojected)
        return dot(measured, reprojected) / energy if energy > 0 else math.nan

    def similarity(self, data_range: float) -> dict[str, float]:
        """Return PSNR, SSIM and cosine similarity over the whole image, unusable pixels dark."""
        measured = np.where(self.usable, self.measured, 0)
        reprojected = np.where(self.usable, self.reprojected, 0)
        figures = {
            "psnr": metrics.psnr(reprojected, measured, data_range=data_range),
            "cosine": metrics.cosine_similarity(reprojected, measured),
            "data_range": data_range,
        }
        if min(measured.shape) >= 7 and measured.any():  # the window of SSIM; dark is 0 / 0
            figures["ssim"] = metrics.ssim(reprojected, measured, data_range=data_range)
        return figures

    def _usable_pixels(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        usable = self.usable
        return self.measured[usable].astype(np.float64), self.reprojected[usable].astype(
            np.float64
        )


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A reconstruction with everything that its report needs.

    Attributes
    ----------
    reconstruction : Solution
    rig : Rig
        All cameras, the held-out ones too.
    views : tuple of View
        One a camera, in the rig's order.
    data_range : float
        The greatest difference that the images can have, for PSNR and SSIM.
    truth : (nx, ny, nz) float32, optional
    comparisons : tuple of Solution
        What other methods made of the same images.
    counts : mapping
        ``rays, segments, voxels, active_voxels``.
    carving : mapping
        Pixels and voxels left out of the system, see `tomo.hull.Carving.report`.
    screening : mapping, optional
        See `tomo.screening.Screening.report`; None where they were not looked for.
    alignment, refinement, gains : mapping, optional
        See `tomo.selfcal.shifts.Alignment.report`, `tomo.selfcal.refine.Refinement.report` and
        `tomo.selfcal.gains.Gains.report`; None where they were not looked for, or the gains not
        corrected.
    refined_rig : Rig, optional
        All cameras, those refined and shifted as they were found, at the size that images were
        recorded in; None where that was not asked for, or found nothing.
    seconds : mapping
        ``load, suspects, prepare, trace, solve, total`` and what else took time; ``choose`` is
        a part of ``solve``.
    first_use_seconds : float
        Compiling or loading kernels, once a process.
    unseen : (nx, ny, nz) bool, optional
        True where no usable ray of any camera crosses the voxel.
    warnings : tuple of str
        What the user should know before trusting the volume.
    options : Options
        What was asked for.
    scan : mapping
        ``frame, scale, grid``: the frame's name, by how much images were shrunk, the voxels.
    projector, basis, pixel_weights : mapping
        The form of the projector, the unknowns and the pixels' weights that were used, and why.
    cosine_distances : tuple of tuple of float
        Of the reconstruction and then of each comparison: the distance from the truth at each
        entry of its history; empty without a truth.
    learned : LearnedWeights, optional
        What was learned in place of chord lengths; None: chords.
    uncertainty : Assessment, optional
        How far the volume is to be trusted, see `tomo.uncertainty`.
    """

    reconstruction: Solution
    rig: Rig
    views: tuple[View, ...]
    data_range: float
    truth: NDArray[np.float32] | None = None
    comparisons: tuple[Solution, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    carving: Mapping[str, Any] = field(default_factory=dict)
    screening: Mapping[str, Any] | None = None
    alignment: Mapping[str, Any] | None = None
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
    cosine_distances: tuple[tuple[float, ...], ...] = ()
    learned: LearnedWeights | None = None
    uncertainty: Assessment | None = None

    @property
    def volume(self) -> NDArray[np.float32]:
        """The volume; where no ray says anything, NaN if that was asked for."""
        volume = self.reconstruction.volume
        if self.unseen is None or self.options.unseen != NOT_A_NUMBER:
            return volume
        return np.where(self.unseen, np.float32(np.nan), volume)

    def report(self) -> dict[str, Any]:
        """Return the contents of ``report.json``: plain numbers, strings, lists and mappings."""
        found = self.reconstruction
        report = {
            "method": found.settings["method"],
            "seconds": dict(self.seconds),
            "first_use_seconds": self.first_use_seconds,
            "peak_memory_mb": found.peak_memory / 1e6,
            **self.counts,
            "scan": dict(self.scan),
            "projector": dict(self.projector),
            "basis": dict(self.basis),
            "pixel_weights": dict(self.pixel_weights),
            "carving": dict(self.carving),
            "screening": self.screening,
            "alignment": self.alignment,
            "refinement": self.refinement,
            "gains": self.gains,
            "learned": self.learned.report() if self.learned else None,
            "uncertainty": self.uncertainty.report() if self.uncertainty else None,
            "relative_residual": found.relative_residual,
            "stop_reason": found.stop_reason,
            "quality": dict(found.quality),
            "held_out": {
                view.name: view.similarity(self.data_range) for view in self.views if view.held_out
            },
            "views": {
                view.name: {
                    "relative_residual": view.relative_residual,
                    "gain": view.gain,
                    "held_out": view.held_out,
                    "left_out": view.left_out,
                }
                for view in self.views
            },
            "comparisons": [
                {
                    "method": other.settings["method"],
                    "seconds": dict(other.seconds),
                    "relative_residual": other.relative_residual,
                    "stop_reason": other.stop_reason,
                    "quality": dict(other.quality),
                    "settings": dict(other.settings),
                }
                for other in self.comparisons
            ],
            "warnings": list(self.warnings),
            "versions": versions(),
            "seed": self.options.seed,
            "settings": self.options.to_mapping(),
            "solver": dict(found.settings),
        }
        return _plain(report)


def quality(volume: NDArray, truth: NDArray | None) -> dict[str, float]:
    """Return the figures of a volume against a truth; empty without one."""
    if truth is None:
        return {}
    total = float(truth.sum(dtype=np.float64))
    return {
        "cosine_distance": metrics.cosine_distance(volume, truth),
        "nrmse": metrics.nrmse(volume, truth),
        "total_ratio": float(volume.sum(dtype=np.float64)) / total if total else math.nan,
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of what computed the result."""
    found = {"python": platform.python_version()}
    for package in _REPORTED_PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _plain(value: object) -> Any:
    """Return JSON's own types; NaN and infinity, which JSON lacks, become None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)
