"""Means of learned weights by the quantities that they may depend on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo.operators import Projector
from tomo.wernet.default.ray_features import FEATURES, RayFeatures
from tomo.wernet.default.ray_weights import RayWeights

MOST_SEGMENTS = 2_000_000
"""Segments from which on some random rays stand for all. More: time. Fewer: noisy means."""

BINS, BINS_IN_A_VOXEL = 20, 10

FAINTEST = 1e-3
"""Fraction of the light below which a bin's mean is NaN. Smaller: means of a few segments."""

NEGLIGIBLE = 1e-3
"""Relative spread of the true weights below which there was nothing to learn."""

_RAYS_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean relative weight against one quantity.

    Attributes
    ----------
    quantity : str
    unit : str
        ``length`` is the grid's.
    edges : (bins + 1,) float64
    light : (bins,) float64
        Fraction of the light, ``length x emission``, in each bin.
    weight : (bins,) float64
        Mean of weight / length; NaN where there is hardly any light.
    truth : (bins,) float64, optional
        The same for the true weights.
    """

    quantity: str
    unit: str
    edges: NDArray[np.float64]
    light: NDArray[np.float64]
    weight: NDArray[np.float64]
    truth: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        """Name the range of the means."""
        low, high = np.nanmin(self.weight), np.nanmax(self.weight)
        return f"<Profile: by {self.quantity}, {low:.3f} to {high:.3f}>"

    @property
    def centre(self) -> NDArray[np.float64]:
        """The middles of the bins, ``(bins,)``."""
        return (self.edges[:-1] + self.edges[1:]) / 2

    def report(self) -> dict[str, Any]:
        """Return plain numbers."""
        columns = {"centre": self.centre, "light": self.light, "weight": self.weight}
        if self.truth is not None:
            columns["truth"] = self.truth
        return {"unit": self.unit} | {name: values.tolist() for name, values in columns.items()}


@dataclass(frozen=True, eq=False)
class LearnedWeights:
    """Relative weights ``(1 + c)²``, the learned weight over the segment length, as means.

    Every mean is weighted by ``length x emission``: segments without light do not count.

    Attributes
    ----------
    mean, spread : float
        Over all segments: the mean, and the standard deviation over the mean.
    cameras : tuple of str
    by_camera : (cameras,) float64
        NaN where a camera sees hardly any light.
    profiles : tuple of Profile
        By depth in the grid, upstream emission, position in the image and in the voxel.
    held_out_residual : mapping
        Relative residuals of left-out views, by ``segment_lengths`` and by ``learned`` weights.
    true_by_camera : (cameras,) float64, optional
        The same as `by_camera` for the true weights.
    explained : float, optional
        One minus the squared distance of the learned weights from the true ones over that of the
        segment lengths, each times its best factor. It is 1 where all is learned, 0 where nothing
        is, and negative where the segment lengths are nearer. None where there was nothing to
        learn.

    Notes
    -----
    No image distinguishes a common factor of all weights from a factor of the volume. True weights
    are therefore scaled to the mean of the learned ones.
    """

    mean: float
    spread: float
    cameras: tuple[str, ...]
    by_camera: NDArray[np.float64]
    profiles: tuple[Profile, ...]
    held_out_residual: Mapping[str, float] = field(default_factory=dict)
    true_by_camera: NDArray[np.float64] | None = None
    explained: float | None = None

    @classmethod
    def of(
        cls,
        weights: RayWeights,
        lengths: Projector,
        learned: Projector,
        volume: ArrayLike,
        cameras: Sequence[str],
        *,
        held_out_residual: Mapping[str, float] | None = None,
        truth: ArrayLike | None = None,
    ) -> LearnedWeights:
        """Return the means of ``weights`` relative to the segment lengths of a projector.

        Parameters
        ----------
        weights : RayWeights
        lengths : Projector
            Stored; its entries are segment lengths and its segments have midpoints.
        learned : Projector
            The result of ``weights.projector(lengths)``.
        volume : (nx, ny, nz) or (unknowns,)
            The emission by which segments count.
        cameras : sequence of str
            The names of the views.
        held_out_residual : mapping, optional
        truth : (S,), optional
            The true weight of each segment over its length.

        Raises
        ------
        ValueError
            If a size does not match.
        """
        _check(lengths, learned, cameras, truth)
        volume = np.asarray(volume)
        flat = lengths.active.compress(volume) if volume.ndim == 3 else volume.ravel()
        features = RayFeatures.of(lengths)
        upstream = features.upstream_emission(weights.volume, weights.unit)
        columns, segment, view = _columns(features, upstream)
        length = lengths.segments.length[segment].astype(np.float64)
        light = length * np.maximum(flat[lengths.segments.voxel[segment]], 0)
        if not light.sum() > 0:
            light = length  # a dark volume: every segment counts by its length
        ratio = _ratio(learned.segments.length[segment], length)
        means = _Means(light, ratio, None if truth is None else np.asarray(truth)[segment])
        by_camera, true_by_camera, _ = means.over(view, len(cameras))
        mean = float(light @ ratio / light.sum())
        spread = math.sqrt(float(light @ np.square(ratio - mean) / light.sum())) / mean
        return cls(
            mean=mean,
            spread=spread,
            cameras=tuple(cameras),
            by_camera=by_camera,
            profiles=tuple(means.profile(*column) for column in columns),
            held_out_residual=dict(held_out_residual or {}),
            true_by_camera=true_by_camera,
            explained=means.explained(),
        )

    def __repr__(self) -> str:
        """Name the mean and the spread."""
        return (
            f"<LearnedWeights: {len(self.cameras)} cameras, mean {self.mean:.3f}, "
            f"spread {self.spread:.1%}>"
        )

    def report(self) -> dict[str, Any]:
        """Return plain numbers for a report, NaN where there is hardly any light."""
        report: dict[str, Any] = {
            "mean": self.mean,
            "spread": self.spread,
            "held_out_residual": dict(self.held_out_residual),
            "cameras": dict(zip(self.cameras, self.by_camera.tolist(), strict=True)),
            "profiles": {profile.quantity: profile.report() for profile in self.profiles},
        }
        if self.true_by_camera is not None:
            true = dict(zip(self.cameras, self.true_by_camera.tolist(), strict=True))
            report |= {"true_cameras": true, "explained": self.explained}
        return report


class _Means:
    """Means, weighted by light, of learned and of equally scaled true relative weights."""

    def __init__(self, light: NDArray, ratio: NDArray, truth: NDArray | None) -> None:
        self.light, self.ratio, self.truth = light, ratio, truth
        if truth is not None:
            self.truth = truth * ((light @ ratio) / (light @ truth))

    def over(self, group: NDArray, count: int) -> tuple[NDArray, NDArray | None, NDArray]:
        """Return the two means of every group, and each group's fraction of the light."""
        total = np.bincount(group, self.light, count)
        fraction = total / total.sum()

        def mean(values: NDArray) -> NDArray:
            sums = np.bincount(group, self.light * values, count)
            enough = fraction >= FAINTEST
            return np.where(enough, sums / np.where(enough, total, 1), np.nan)

        truth = None if self.truth is None else mean(self.truth)
        return mean(self.ratio), truth, fraction

    def profile(
        self, quantity: str, unit: str, values: NDArray, ends: tuple[float, float], bins: int
    ) -> Profile:
        """Return the means in equal bins."""
        low, high = ends
        edges = np.linspace(low, high, bins + 1)
        number = ((values - low) / (high - low) * bins).astype(np.int64).clip(0, bins - 1)
        weight, truth, light = self.over(number, bins)
        return Profile(quantity, unit, edges, light, weight, truth)

    def explained(self) -> float | None:
        """Return `LearnedWeights.explained`."""
        if self.truth is None:
            return None
        light, ratio, truth = self.light, self.ratio, self.truth

        def apart(values: NDArray) -> float:
            factor = (light * values @ truth) / (light @ np.square(values))
            return float(light @ np.square(factor * values - truth))

        lengths = apart(np.ones_like(ratio))
        nothing = NEGLIGIBLE**2 * float(light @ np.square(truth))
        return 1 - apart(ratio) / lengths if lengths > nothing else None


def _columns(
    features: RayFeatures, upstream: torch.Tensor
) -> tuple[list[tuple[str, str, NDArray, tuple[float, float], int]], NDArray, NDArray]:
    """Return the arguments of `_Means.profile`, and the segment and view of each row."""
    nonempty = features.count.nonzero()[:, 0]
    enough = math.ceil(len(nonempty) * MOST_SEGMENTS / max(len(features.voxel), 1))
    if enough < len(nonempty):  # not every n-th: that may be one column of the images
        drawn = torch.randperm(len(nonempty), generator=torch.Generator().manual_seed(0))
        nonempty = nonempty[drawn[:enough].sort().values]
    described, segments, views = [], [], []
    for rays in nonempty.split(_RAYS_AT_ONCE):
        packing, rows = features.packed(rays, upstream)
        described.append(rows)
        segments.append(packing.segment)
        views.append(packing.per_segment(features.view[rays]))
    numbers = dict(zip(FEATURES, torch.cat(described).numpy().T, strict=True))
    across, up = (numbers[f"position in the image, {way}"] for way in ("across", "up"))
    depth = (numbers["depth in the grid"] + 1) / 2 * features.shortest_edge
    emission, radius = numbers["upstream emission"], np.hypot(across, up)
    columns = [
        ("depth in the grid", "length", depth, (0.0, _end(depth)), BINS),
        ("upstream emission", "root mean square pixel", emission, (0.0, _end(emission)), BINS),
        ("distance from the image's middle", "largest", radius, (0.0, _end(radius)), BINS),
    ]
    for axis in "xyz":
        name = f"position in the voxel, {axis}"
        inside = numbers[name] / 2
        columns.append((name, "voxel", inside, (-0.5, 0.5), BINS_IN_A_VOXEL))
    return columns, torch.cat(segments).numpy(), torch.cat(views).numpy()


def _end(values: NDArray) -> float:
    """Return the upper end of a quantity that starts at zero."""
    return max(float(values.max()), float(np.finfo(np.float32).tiny))


def _ratio(weight: NDArray, length: NDArray) -> NDArray[np.float64]:
    return np.where(length > 0, weight / np.where(length > 0, length, 1), 1.0)


def _check(
    lengths: Projector, learned: Projector, cameras: Sequence[str], truth: ArrayLike | None
) -> None:
    segments = len(lengths.segments)
    if not segments:
        raise ValueError("lengths: found no segment, expected rays that cross voxels")
    found = {"learned": len(learned.segments)}
    if truth is not None:
        found["truth"] = np.size(truth)
    for name, count in found.items():
        if count != segments:
            raise ValueError(f"{name}: found {count} segments, expected {segments} as of lengths")
    if len(cameras) != lengths.n_views:
        raise ValueError(f"cameras: found {len(cameras)} names, expected {lengths.n_views}")
