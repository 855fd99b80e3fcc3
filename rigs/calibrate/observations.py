"""Observations of a target: what detection gives and calibration takes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, repr=False)
class Observations:
    """Where each camera saw each point of the target in each frame, one row per observation.

    Parameters
    ----------
    target_points : (points, 3) float64
        The target's points in its own axes, flat: z = 0, in the target's length unit.
    cameras : tuple of str
    image_sizes : tuple of (int, int)
        Width and height of each camera's images.
    frames : tuple of str
        Moments in time: images of one frame show the target at rest in one pose.
    camera, frame, point : (observations,) int64
        Indices into ``cameras``, ``frames`` and ``target_points``.
    uv : (observations, 2) float64
        Pixel coordinates (column, row), pixel centres at integers.

    Raises
    ------
    ValueError
        If shapes disagree, a number is not finite, an index is out of range, or one camera sees
        one point twice in a frame.
    """

    target_points: NDArray[np.float64]
    cameras: tuple[str, ...]
    image_sizes: tuple[tuple[int, int], ...]
    frames: tuple[str, ...]
    camera: NDArray[np.int64]
    frame: NDArray[np.int64]
    point: NDArray[np.int64]
    uv: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        points = np.array(self.target_points, np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ValueError(f"target_points: found shape {points.shape}, expected finite (n, 3)")
        uv = np.array(self.uv, np.float64).reshape(-1, 2)
        if not np.isfinite(uv).all():
            raise ValueError("uv: found a number that is not finite, expected pixel coordinates")
        if len(self.image_sizes) != len(self.cameras):
            raise ValueError(
                f"image_sizes: found {len(self.image_sizes)}, expected {len(self.cameras)}, "
                "one per camera"
            )
        arrays: dict[str, NDArray] = {"target_points": points, "uv": uv}
        limits = {"camera": len(self.cameras), "frame": len(self.frames), "point": len(points)}
        for name, limit in limits.items():
            indices = np.array(getattr(self, name), np.int64).reshape(-1)
            if len(indices) != len(uv):
                raise ValueError(f"{name}: found {len(indices)} rows, expected {len(uv)} as in uv")
            if len(indices) and not (indices.min() >= 0 and indices.max() < limit):
                raise ValueError(f"{name}: found an index outside 0 to {limit - 1}")
            arrays[name] = indices
        keys = np.stack([arrays[name] for name in limits], axis=-1)  # (observations, 3)
        if len(np.unique(keys, axis=0)) != len(keys):
            raise ValueError("point: found twice in one image, expected once")
        for name, array in arrays.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        sizes = tuple((int(width), int(height)) for width, height in self.image_sizes)
        object.__setattr__(self, "image_sizes", sizes)
        for name in ("cameras", "frames"):
            object.__setattr__(self, name, tuple(getattr(self, name)))

    def __repr__(self) -> str:
        return (
            f"<Observations: {len(self)} observations of {len(self.target_points)} points by "
            f"{len(self.cameras)} cameras in {len(self.frames)} frames>"
        )

    def __len__(self) -> int:
        return len(self.uv)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Observations):
            return NotImplemented
        return all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)
        )

    def where(self, keep: NDArray[np.bool_]) -> Observations:
        """Return the observations where ``keep`` ``(N,)`` holds; cameras and frames stay."""
        rows = {name: getattr(self, name)[keep] for name in ("camera", "frame", "point", "uv")}
        return replace(self, **rows)

    def counts(self) -> NDArray[np.int64]:
        """Return how many points each camera saw in each frame, ``(cameras, frames)``."""
        counts = np.zeros((len(self.cameras), len(self.frames)), np.int64)
        np.add.at(counts, (self.camera, self.frame), 1)
        return counts


def without_repeats(
    observations: Observations,
) -> tuple[NDArray[np.bool_], tuple[str, ...], tuple[str, ...]]:
    """Return which observations to keep, and lines on frozen cameras and on repeats.

    An image is a repeat whose observations equal an earlier one's to the last digit: noise never
    repeats itself. A camera is frozen that repeats one while others do not.
    """
    keep = np.ones(len(observations), bool)
    first: dict[tuple[int, bytes], int] = {}
    repeats: dict[tuple[int, int], list[int]] = {}
    order = np.lexsort((observations.point, observations.camera, observations.frame))
    image = observations.frame[order] * len(observations.cameras) + observations.camera[order]
    for rows in np.split(order, np.flatnonzero(np.diff(image)) + 1):
        if not len(rows):
            continue
        camera, frame = int(observations.camera[rows[0]]), int(observations.frame[rows[0]])
        content = observations.point[rows].tobytes() + observations.uv[rows].tobytes()
        earlier = first.setdefault((camera, content), frame)
        if earlier != frame:
            keep[rows] = False
            repeats.setdefault((earlier, frame), []).append(camera)
    counts = observations.counts()
    frozen, notes = [], []
    for (earlier, frame), cameras in sorted(repeats.items()):
        first_name, name = observations.frames[earlier], observations.frames[frame]
        if len(cameras) == np.count_nonzero(counts[:, frame]):
            notes.append(f"frame {name}: the same as {first_name} in every camera, counted once")
        else:
            named = ", ".join(observations.cameras[camera] for camera in cameras)
            frozen.append(
                f"camera {named}: frame {name} is the same image as {first_name} while other "
                "cameras have new ones; it was left out. Check that the cameras are synchronised"
            )
    return keep, tuple(frozen), tuple(notes)
