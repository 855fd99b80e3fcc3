"""The plots of a calibration: residuals and coverage over the images, depths, worst images."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import box_points
from rigs.scene.scene_camera import own_camera
from tomo.draw.figures import INK, MUTED, new_figure, plain, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    from rigs.calibrate import Calibration, Observations
    from tomo.grid import VoxelGrid

ImageOf = Callable[[str, str], NDArray | None]
"""Returns the grey image that a camera took in a frame, or None where there is none to show."""

_CELLS = 14  # along an image's longer side
_ACROSS = 4  # panels in a row
_MAGNIFIED = 20  # residuals in the worst images
_DETECTED, _PROJECTED, _CULLED = "#1f6fb2", "#c2500f", "#9a7b00"


def draw_residuals(calibration: Calibration) -> Figure:
    """Return, per camera, mean residuals as arrows over their RMS, cell by cell of the image."""
    observations = calibration.observations
    cells = [_Cells(observations, index) for index in range(len(observations.cameras))]
    used = calibration.used
    maps = []
    for index, cell in enumerate(cells):
        mine = np.flatnonzero(used & (observations.camera == index))
        residuals = calibration.residuals[mine]
        count = cell.sums(mine, np.ones(len(mine)))
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.stack(
                [cell.sums(mine, residuals[:, k]) / count for k in range(2)], axis=-1
            )  # (down, across, 2)
            rms = np.sqrt(cell.sums(mine, (residuals**2).sum(axis=1)) / count)
        maps.append((mean, rms, count))
    highest = _quantile([rms for _, rms, _ in maps], 0.98)
    longest = _quantile([np.linalg.norm(mean, axis=-1) for mean, _, _ in maps], 0.95)
    figure, panels = _panels(observations)
    shown = []
    for axes, cell, (mean, rms, count), name in zip(
        panels, cells, maps, observations.cameras, strict=True
    ):
        image = axes.imshow(
            rms, extent=cell.extent, cmap="YlOrBr", vmin=0, vmax=highest, interpolation="nearest"
        )
        shown.append(image)
        row, column = np.nonzero(count >= 3)
        x, y = cell.middles(row, column)
        u, v = (mean[row, column] * cell.side / longest).T
        axes.quiver(
            x,
            y,
            u,
            v,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.006,
            color=INK,
            pivot="mid",
        )
        axes.set_title(plain(name), fontsize=8, color=INK, pad=3)
    _bar(figure, shown[-1], "RMS residual in a cell (px)")
    figure.text(
        0.99, 0.008 * 9 / figure.get_figheight(),
        f"an arrow as long as a cell: mean residual {longest:.2g} px",
        fontsize=7.5, color=MUTED, ha="right", va="bottom",
    )  # fmt: skip
    return figure


def draw_coverage(calibration: Calibration) -> Figure:
    """Return the number of observations used in each cell of each camera's image."""
    observations = calibration.observations
    figure, panels = _panels(observations)
    maps = []
    for index in range(len(observations.cameras)):
        cell = _Cells(observations, index)
        mine = np.flatnonzero(calibration.used & (observations.camera == index))
        maps.append((cell, cell.sums(mine, np.ones(len(mine)))))
    highest = max(_quantile([count for _, count in maps], 0.98), 1.0)
    shown = []
    for axes, (cell, count), name in zip(panels, maps, observations.cameras, strict=True):
        image = axes.imshow(
            np.where(count > 0, count, np.nan), extent=cell.extent, cmap="GnBu", vmin=0,
            vmax=highest, interpolation="nearest",
        )  # fmt: skip
        shown.append(image)
        fraction = f"{np.mean(count > 0):.0%}"
        axes.set_title(f"{plain(name)}: {fraction}", fontsize=8, color=INK, pad=3)
    _bar(figure, shown[-1], "observations per cell; titles give the fraction of cells with any")
    return figure


def draw_depths(calibration: Calibration, grid: VoxelGrid | None = None) -> Figure:
    """Return the distances of the target from each camera, compared with the volume's."""
    observations, rig = calibration.observations, calibration.rig
    figure = new_figure(9.0, 0.7 + 0.26 * len(rig))
    axes = figure.add_axes(
        (0.16, 0.46 / figure.get_figheight(), 0.8, 1 - 0.75 / figure.get_figheight())
    )
    for index, camera in enumerate(map(own_camera, rig)):
        mine = np.flatnonzero(calibration.used & (observations.camera == index))
        frames = observations.frame[mine]
        points = observations.target_points[observations.point[mine]]
        world = (
            np.einsum("nij,nj->ni", calibration.target_R[frames], points)
            + calibration.target_t[frames]
        )
        if grid is not None:
            corners = box_points(grid.lower, grid.upper, 2)
            depth = corners @ camera.R[2] + camera.t[2]
            axes.barh(index, np.ptp(depth), left=depth.min(), height=0.8, color="#e3e7eb")
        if len(world):
            low, first, third, high = np.quantile(
                world @ camera.R[2] + camera.t[2], [0, 0.25, 0.75, 1]
            )
            axes.plot([low, high], [index, index], color=_DETECTED, linewidth=1.2)
            axes.plot([first, third], [index, index], color=_DETECTED, linewidth=5)
    thin_lines(axes)
    axes.set_yticks(range(len(rig)), [plain(name) for name in rig.names])
    axes.set_ylim(len(rig) - 0.4, -0.6)
    axes.set_xlabel(f"depth ({plain(rig.length_unit)})", fontsize=8)
    words = "line: all observations; thick: their middle half"
    axes.set_title(
        words + ("; grey: the volume" if grid is not None else ""), fontsize=8, color=MUTED
    )
    return figure


def worst_images(calibration: Calibration, most: int = 6) -> list[tuple[int, int, float]]:
    """Return (camera, frame, RMS in pixels) of the images that fit worst, culled points too."""
    observations = calibration.observations
    shape = len(observations.cameras), len(observations.frames)
    posed = np.isfinite(calibration.residuals).all(axis=1)
    squares = (calibration.residuals[posed] ** 2).sum(axis=1)
    sums, counts = np.zeros(shape), np.zeros(shape)
    place = observations.camera[posed], observations.frame[posed]
    np.add.at(sums, place, squares)
    np.add.at(counts, place, 1.0)
    rms = np.where(counts > 0, np.sqrt(sums / np.maximum(counts, 1)), -1.0)
    order = np.argsort(-rms, axis=None, kind="stable")
    pairs = [(int(k // shape[1]), int(k % shape[1]), float(rms.flat[k])) for k in order]
    return [pair for pair in pairs if pair[2] >= 0][:most]


def draw_worst(calibration: Calibration, image_of: ImageOf, most: int = 6) -> Figure | None:
    """Return the worst images with points as detected and as projected; None without images."""
    observations = calibration.observations
    shown = []
    for camera, frame, rms in worst_images(calibration, most):
        image = image_of(observations.cameras[camera], observations.frames[frame])
        if image is not None:
            shown.append((camera, frame, rms, image))
    if not shown:
        return None
    across = min(3, len(shown))
    down = math.ceil(len(shown) / across)
    side = 10.4 / across
    figure = new_figure(10.4, down * (0.8 * side + 0.3) + 0.25)
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for axes, (camera, frame, rms, image) in zip(grid.flat, shown, strict=False):
        mine = (observations.camera == camera) & (observations.frame == frame)
        _overlay(axes, image, observations.uv[mine], calibration.residuals[mine],
                 calibration.used[mine])  # fmt: skip
        axes.set_title(
            f"{plain(observations.cameras[camera])}, {plain(observations.frames[frame])}: "
            f"RMS {rms:.3g} px",
            fontsize=8,
            color=INK,
            pad=3,
        )
    figure.tight_layout(pad=0.4, h_pad=1.4, rect=(0, 0.25 / figure.get_figheight(), 1, 1))
    for k, (words, colour) in enumerate(
        (
            ("detected", _DETECTED),
            ("detected, left out", _CULLED),
            (f"projected; lines: {_MAGNIFIED} x the way there", _PROJECTED),
        )
    ):
        figure.text(0.02 + 0.13 * k, 0.01, words, fontsize=8, color=colour, weight="bold")
    return figure


def _overlay(axes: Axes, image: NDArray, uv: NDArray, residuals: NDArray, used: NDArray) -> None:
    """Show the part of an image that holds the points, in the image's own coordinates."""
    low, high = uv.min(axis=0), uv.max(axis=0)
    margin = 0.15 * float((high - low).max()) + 8
    height, width = image.shape[:2]
    left, top = np.maximum(np.floor(low - margin), 0).astype(int)
    right, bottom = np.minimum(np.ceil(high + margin) + 1, [width, height]).astype(int)
    axes.imshow(
        image[top:bottom, left:right], cmap="gray", vmin=0,
        extent=(left - 0.5, right - 0.5, bottom - 0.5, top - 0.5), alpha=0.75,
    )  # fmt: skip
    for keep, colour in ((used, _DETECTED), (~used, _CULLED)):
        axes.plot(*uv[keep].T, "o", markersize=6, markerfacecolor="none", color=colour,
                  markeredgewidth=1)  # fmt: skip
    axes.plot(*(uv - residuals).T, "x", markersize=4, color=_PROJECTED, markeredgewidth=1)
    ends = np.stack([uv, uv - _MAGNIFIED * residuals], axis=1)  # (N, 2, 2)
    for line in ends[np.isfinite(ends).all(axis=(1, 2))]:
        axes.plot(*line.T, color=_PROJECTED, linewidth=0.8)
    axes.set_xlim(left - 0.5, right - 0.5)
    axes.set_ylim(bottom - 0.5, top - 0.5)
    _no_ticks(axes)


class _Cells:
    """Square cells of one camera's image."""

    def __init__(self, observations: Observations, camera: int) -> None:
        width, height = observations.image_sizes[camera]
        self.side = max(width, height) / _CELLS
        self.shape = math.ceil(height / self.side - 1e-9), math.ceil(width / self.side - 1e-9)
        self.extent = (
            -0.5, self.shape[1] * self.side - 0.5, self.shape[0] * self.side - 0.5, -0.5
        )  # fmt: skip
        self._uv = observations.uv

    def sums(self, observations: NDArray, values: NDArray) -> NDArray[np.float64]:
        """Return the sums of ``values`` over the observations in each cell."""
        place = np.floor((self._uv[observations] + 0.5) / self.side).astype(int)
        column, row = (np.clip(place[:, k], 0, self.shape[1 - k] - 1) for k in range(2))
        sums = np.zeros(self.shape)
        np.add.at(sums, (row, column), values)
        return sums

    def middles(self, row: NDArray, column: NDArray) -> tuple[NDArray, NDArray]:
        """Return the middles of cells in pixel coordinates."""
        return (column + 0.5) * self.side - 0.5, (row + 0.5) * self.side - 0.5


def _quantile(maps: list[NDArray], fraction: float) -> float:
    """Return a quantile of the finite values of several maps; 1 where there are none."""
    values = np.concatenate([m[np.isfinite(m)] for m in maps])
    return (float(np.quantile(values, fraction)) if values.size else 0.0) or 1.0


def _panels(observations: Observations) -> tuple[Figure, list[Axes]]:
    """Return a figure with a panel for each camera's image, row by row."""
    count = len(observations.cameras)
    across = min(_ACROSS, max(count, 2))
    down = math.ceil(count / across)
    aspect = max(height / width for width, height in observations.image_sizes)
    width, gap, heading, foot = 10.4, 0.12, 0.24, 0.55
    side = (width - gap * (across + 1)) / across
    height = down * (side * min(aspect, 1.4) + heading) + foot
    figure = new_figure(width, height)
    panels = []
    for number, (image_width, image_height) in enumerate(observations.image_sizes):
        row, column = divmod(number, across)
        tall = side * min(aspect, 1.4)
        axes = figure.add_axes(
            (
                (gap + column * (side + gap)) / width,
                1 - ((row + 1) * (tall + heading) - 0.02) / height,
                side / width,
                tall / height,
            )
        )
        axes.set_xlim(-0.5, image_width - 0.5)
        axes.set_ylim(image_height - 0.5, -0.5)
        axes.set_aspect("equal")
        _no_ticks(axes)
        panels.append(axes)
    return figure, panels


def _no_ticks(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set(color="#c3cad1", linewidth=0.6)


def _bar(figure: Figure, shown: ScalarMappable, words: str) -> None:
    """Add a colour bar at the bottom on the left."""
    height = figure.get_figheight()
    bar = figure.add_axes((0.012, 0.36 / height, 0.3, 0.09 / height))
    figure.colorbar(shown, cax=bar, orientation="horizontal")
    bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
    bar.set_xlabel(words, fontsize=7, color=INK, labelpad=2, loc="left")
