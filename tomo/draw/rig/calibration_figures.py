"""The plots of a calibration: residuals and coverage over the images, depths, worst images."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import box_points
from rigs.scene.scene_camera import own_camera
from tomo.draw.figures import INK, MUTED, new_figure, plain, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

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
    observations, residuals = calibration.observations, calibration.residuals
    maps = []
    for cell in _cells_of(calibration):
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.stack(
                [cell.sums(residuals[cell.used, k]) / cell.counts for k in range(2)], axis=-1
            )  # (down, across, 2)
            rms = np.sqrt(cell.sums((residuals[cell.used] ** 2).sum(axis=1)) / cell.counts)
        maps.append((cell, mean, rms))
    highest = _quantile([rms for *_, rms in maps], 0.98)
    longest = _quantile([np.linalg.norm(mean, axis=-1) for _, mean, _ in maps], 0.95)
    figure, panels = _panels(len(maps), _aspect(observations))
    for axes, (cell, mean, rms), name in zip(panels, maps, observations.cameras, strict=False):
        image = _show(axes, cell, rms, "YlOrBr", highest, name)
        row, column = np.nonzero(cell.counts >= 3)
        x, y = (column + 0.5) * cell.side - 0.5, (row + 0.5) * cell.side - 0.5
        u, v = (mean[row, column] * cell.side / longest).T
        axes.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=1.0, width=0.006, color=INK,
                    pivot="mid")  # fmt: skip
    words = f"an arrow as long as a cell: mean residual {longest:.2g} px"
    _bar(figure, image, f"RMS residual in a cell (px); {words}", panels)
    return figure


def draw_coverage(calibration: Calibration) -> Figure:
    """Return the number of observations used in each cell of each camera's image."""
    observations, cells = calibration.observations, _cells_of(calibration)
    highest = max(_quantile([cell.counts for cell in cells], 0.98), 1.0)
    figure, panels = _panels(len(cells), _aspect(observations))
    for axes, cell, name in zip(panels, cells, observations.cameras, strict=False):
        shown = np.where(cell.counts > 0, cell.counts, np.nan)
        title = f"{name}: {np.mean(cell.counts > 0):.0%}"
        image = _show(axes, cell, shown, "GnBu", highest, title)
    words = "observations per cell; titles give the fraction of cells with any"
    _bar(figure, image, words, panels)
    return figure


def draw_depths(calibration: Calibration, grid: VoxelGrid | None = None) -> Figure:
    """Return the distances of the target from each camera, compared with the volume's."""
    observations, rig = calibration.observations, calibration.rig
    figure = new_figure(9.0, 0.7 + 0.26 * len(rig))
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
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
    figure, panels = _panels(len(shown), 0.8, across=3)
    for axes, (camera, frame, rms, image) in zip(panels, shown, strict=False):
        mine = (observations.camera == camera) & (observations.frame == frame)
        _overlay(axes, image, observations.uv[mine], calibration.residuals[mine],
                 calibration.used[mine])  # fmt: skip
        words = f"{observations.cameras[camera]}, {observations.frames[frame]}: RMS {rms:.3g} px"
        axes.set_title(plain(words), fontsize=8, color=INK, pad=3)
    names = "detected", "detected, left out", f"projected; lines: {_MAGNIFIED} x the way there"
    marks = [
        axes.plot([], [], mark, markerfacecolor="none", color=colour, label=name)[0]
        for mark, colour, name in zip("oox", (_DETECTED, _CULLED, _PROJECTED), names, strict=True)
    ]
    figure.legend(handles=marks, loc="outside lower left", ncols=3, fontsize=8, frameon=False)
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


@dataclass(frozen=True, eq=False)
class _Cells:
    """Square cells of one camera's image, and the observations used in them."""

    size: tuple[int, int]
    uv: NDArray[np.float64]
    used: NDArray[np.int64]  # places among all observations

    @property
    def side(self) -> float:
        """Pixels of a cell."""
        return max(self.size) / _CELLS

    @property
    def shape(self) -> tuple[int, int]:
        """Cells down and across."""
        across, down = (math.ceil(length / self.side - 1e-9) for length in self.size)
        return down, across

    @cached_property
    def counts(self) -> NDArray[np.float64]:
        """Observations in each cell."""
        return self.sums(np.ones(len(self.used)))

    def sums(self, values: NDArray) -> NDArray[np.float64]:
        """Return the sums of ``values`` of the observations over each cell."""
        place = np.floor((self.uv[self.used] + 0.5) / self.side).astype(int)
        column, row = (np.clip(place[:, k], 0, self.shape[1 - k] - 1) for k in range(2))
        sums = np.zeros(self.shape)
        np.add.at(sums, (row, column), values)
        return sums


def _cells_of(calibration: Calibration) -> list[_Cells]:
    """Return the cells of every camera."""
    own = calibration.observations
    return [
        _Cells(size, own.uv, np.flatnonzero(calibration.used & (own.camera == index)))
        for index, size in enumerate(own.image_sizes)
    ]


def _quantile(maps: list[NDArray], fraction: float) -> float:
    """Return a quantile of the finite values of several maps; 1 where there are none."""
    values = np.concatenate([m[np.isfinite(m)] for m in maps])
    return (float(np.quantile(values, fraction)) if values.size else 0.0) or 1.0


def _aspect(observations: Observations) -> float:
    """Return height over width of the panels of images."""
    return min(max(height / width for width, height in observations.image_sizes), 1.4)


def _panels(count: int, aspect: float, across: int = _ACROSS) -> tuple[Figure, list[Axes]]:
    """Return a figure with a panel for each image, row by row; the rest of the last is empty."""
    across = min(across, max(count, 2))
    down = math.ceil(count / across)
    figure = new_figure(10.4, down * (10.4 / across * aspect + 0.3) + 0.4)
    figure.set_layout_engine("constrained", w_pad=0.04, h_pad=0.04)
    panels = figure.subplots(down, across, squeeze=False).ravel().tolist()
    for axes in panels:
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set(color="#c3cad1", linewidth=0.6)
    for axes in panels[count:]:
        axes.set_visible(False)
    return figure, panels


def _show(
    axes: Axes, cell: _Cells, values: NDArray, colours: str, highest: float, title: str
) -> AxesImage:
    """Show numbers of cells in an image's own coordinates."""
    down, across = cell.shape
    extent = (-0.5, across * cell.side - 0.5, down * cell.side - 0.5, -0.5)
    image = axes.imshow(values, cmap=colours, vmin=0, vmax=highest, extent=extent)
    width, height = cell.size
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    axes.set_title(plain(title), fontsize=8, color=INK, pad=3)
    return image


def _bar(figure: Figure, shown: AxesImage, words: str, panels: list[Axes]) -> None:
    """Add a colour bar at the bottom on the left."""
    bar = figure.colorbar(shown, ax=panels, location="bottom", anchor=(0.0, 0.5), shrink=0.4,
                          aspect=40, pad=0.02)  # fmt: skip
    bar.ax.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
    bar.ax.set_xlabel(words, fontsize=7, color=INK, labelpad=2, loc="left")
