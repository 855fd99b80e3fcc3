"""What a correction learned, summed up: mean relative weights by the quantities it may hang on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo._compute.by_camera import by_name
from tomo.operators import Projector
from tomo.wernet.default.ray_features import NAMES, RayFeatures
from tomo.wernet.default.ray_weights import RayWeights

CROSSINGS = 2_000_000
"""Of more, some rays drawn at random are enough for means."""

BINS, BINS_IN_A_VOXEL = 20, 10

FAINTEST = 1e-3
"""Share of the light below which a bin's mean is left open."""

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
    share : (bins,) float64
        Of the light: of chord x emission.
    weight : (bins,) float64
        Mean of weight / chord; NaN where there is hardly any light.
    truth : (bins,) float64, optional
        The same of the true weights.
    """

    quantity: str
    unit: str
    edges: NDArray[np.float64]
    share: NDArray[np.float64]
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
        columns = {"centre": self.centre, "share": self.share, "weight": self.weight}
        if self.truth is not None:
            columns["truth"] = self.truth
        return {"unit": self.unit} | {name: values.tolist() for name, values in columns.items()}


@dataclass(frozen=True, eq=False)
class LearnedWeights:
    """Relative weights ``(1 + c)²``, the learned weight over the chord, in means.

    Every mean is weighted by chord x emission: what light never takes does not count.

    Attributes
    ----------
    mean, spread : float
        Over all segments: the mean, and the standard deviation over the mean.
    cameras : tuple of str
    by_camera : (cameras,) float64
        NaN where a camera sees hardly any light.
    profiles : tuple of Profile
        By depth in the grid, emission in front, place in the image and in the voxel.
    held_out_residual : mapping
        Relative residual of left-out views, with ``chords`` and with ``learned`` weights.
    true_by_camera : (cameras,) float64, optional
        What `by_camera` is of the true weights.
    explained : float, optional
        One minus the squared distance of the learned weights from the true ones over that of the
        chords, either times the factor that suits it best: 1 where all is learned, 0 where nothing
        is, negative where the chords are nearer. None where there was nothing to learn.

    Notes
    -----
    A common factor of all weights is one of the volume, and no image tells them apart: true
    weights are scaled to the mean of the learned ones.
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
        chords: Projector,
        learned: Projector,
        volume: ArrayLike,
        cameras: Sequence[str],
        *,
        held_out_residual: Mapping[str, float] | None = None,
        truth: ArrayLike | None = None,
    ) -> LearnedWeights:
        """Sum up what ``weights`` made of the chords of a projector.

        Parameters
        ----------
        weights : RayWeights
        chords : Projector
            Stored, its segments with midpoints.
        learned : Projector
            What ``weights.projector(chords)`` gave.
        volume : (nx, ny, nz) or (unknowns,)
            The emission by which segments count.
        cameras : sequence of str
            The names of the views.
        held_out_residual : mapping, optional
        truth : (S,), optional
            The true weight of each segment over its chord.

        Raises
        ------
        ValueError
            If a size does not match.
        """
        _check(chords, learned, cameras, truth)
        volume = np.asarray(volume)
        flat = chords.active.compress(volume) if volume.ndim == 3 else volume.ravel()
        features = RayFeatures.of(chords)
        front = features.emission_in_front(weights.volume, weights.unit)
        columns, entry, view = _columns(features, front)
        chord = chords.segments.length[entry].astype(np.float64)
        light = chord * np.maximum(flat[chords.segments.voxel[entry]], 0)
        if not light.sum() > 0:
            light = chord  # a dark volume: every segment counts by its length
        ratio = _ratio(learned.segments.length[entry], chord)
        means = _Means(light, ratio, None if truth is None else np.asarray(truth)[entry])
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
        """Name the size of what was learned."""
        return (
            f"<LearnedWeights: {len(self.cameras)} cameras, mean {self.mean:.3f}, "
            f"spread {self.spread:.1%}>"
        )

    def report(self) -> dict[str, Any]:
        """Return what a report says of it: plain numbers, NaN where there is hardly any light."""
        report: dict[str, Any] = {
            "mean": self.mean,
            "spread": self.spread,
            "held_out_residual": dict(self.held_out_residual),
            "cameras": by_name(self.cameras, self.by_camera),
            "profiles": {profile.quantity: profile.report() for profile in self.profiles},
        }
        if self.true_by_camera is not None:
            true = by_name(self.cameras, self.true_by_camera)
            report |= {"true_cameras": true, "explained": self.explained}
        return report


class _Means:
    """Means by light of the learned and, scaled to the same mean, of the true relative weights."""

    def __init__(self, light: NDArray, ratio: NDArray, truth: NDArray | None) -> None:
        self.light, self.ratio, self.truth = light, ratio, truth
        if truth is not None:
            self.truth = truth * ((light @ ratio) / (light @ truth))

    def over(self, group: NDArray, count: int) -> tuple[NDArray, NDArray | None, NDArray]:
        """Return the two means of every group, and each group's share of the light."""
        total = np.bincount(group, self.light, count)
        share = total / total.sum()

        def mean(values: NDArray | None) -> NDArray | None:
            if values is None:
                return None
            sums = np.bincount(group, self.light * values, count)
            enough = share >= FAINTEST
            return np.where(enough, sums / np.where(enough, total, 1), np.nan)

        return mean(self.ratio), mean(self.truth), share

    def profile(
        self, quantity: str, unit: str, values: NDArray, ends: tuple[float, float], bins: int
    ) -> Profile:
        """Return the means in equal bins."""
        low, high = ends
        edges = np.linspace(low, high, bins + 1)
        place = ((values - low) / (high - low) * bins).astype(np.int64).clip(0, bins - 1)
        weight, truth, share = self.over(place, bins)
        return Profile(quantity, unit, edges, share, weight, truth)

    def explained(self) -> float | None:
        """Return how much nearer than the chords the learned weights are to the true ones."""
        if self.truth is None:
            return None
        light, ratio, truth = self.light, self.ratio, self.truth

        def apart(values: NDArray) -> float:
            factor = (light * values @ truth) / (light @ np.square(values))
            return float(light @ np.square(factor * values - truth))

        chords = apart(np.ones_like(ratio))
        nothing = NEGLIGIBLE**2 * float(light @ np.square(truth))
        return 1 - apart(ratio) / chords if chords > nothing else None


def _columns(
    features: RayFeatures, front: torch.Tensor
) -> tuple[list[tuple[str, str, NDArray, tuple[float, float], int]], NDArray, NDArray]:
    """Return the quantities with what `_Means.profile` needs, and each row's segment and view."""
    crossing = features.count.nonzero()[:, 0]
    enough = math.ceil(len(crossing) * CROSSINGS / max(len(features.voxel), 1))
    if enough < len(crossing):  # not every n-th: that may be one column of the images
        drawn = torch.randperm(len(crossing), generator=torch.Generator().manual_seed(0))
        crossing = crossing[drawn[:enough].sort().values]
    described, entries, views = [], [], []
    for rays in crossing.split(_RAYS_AT_ONCE):
        packing, numbers = features.packed(rays, front)
        described.append(numbers)
        entries.append(packing.entry)
        views.append(packing.per_segment(features.view[rays]))
    numbers = dict(zip(NAMES, torch.cat(described).numpy().T, strict=True))
    across, up = (numbers[f"place in the image, {way}"] for way in ("across", "up"))
    depth = (numbers["depth in the grid"] + 1) / 2 * features.shortest
    in_front, radius = numbers["emission in front"], np.hypot(across, up)
    columns = [
        ("depth in the grid", "length", depth, (0.0, _end(depth)), BINS),
        ("emission in front", "root mean square pixel", in_front, (0.0, _end(in_front)), BINS),
        ("distance from the image's middle", "largest", radius, (0.0, _end(radius)), BINS),
    ]
    for axis in "xyz":
        inside = numbers[f"place in the voxel, {axis}"] / 2
        name = f"place in the voxel, {axis}"
        columns.append((name, "voxel", inside, (-0.5, 0.5), BINS_IN_A_VOXEL))
    return columns, torch.cat(entries).numpy(), torch.cat(views).numpy()


def _end(values: NDArray) -> float:
    """Return the upper end of a quantity that starts at zero."""
    return max(float(values.max()), np.finfo(np.float32).tiny)


def _ratio(weight: NDArray, chord: NDArray) -> NDArray[np.float64]:
    return np.where(chord > 0, weight / np.where(chord > 0, chord, 1), 1.0)


def _check(
    chords: Projector, learned: Projector, cameras: Sequence[str], truth: ArrayLike | None
) -> None:
    segments = len(chords.segments)
    if not segments:
        raise ValueError("chords: found no segment, expected rays that cross voxels")
    found = {"learned": len(learned.segments)}
    if truth is not None:
        found["truth"] = np.size(truth)
    for name, count in found.items():
        if count != segments:
            raise ValueError(f"{name}: found {count} segments, expected {segments} as of chords")
    if len(cameras) != chords.n_views:
        raise ValueError(f"cameras: found {len(cameras)} names, expected {chords.n_views}")
