"""Families of fields that figures are reported on; no rule is settled on them.

Each takes a random generator and the grid's half edges ``(3,)`` in voxels, and returns its
emission.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.scenes.shapes import (
    Shape,
    Values,
    bell,
    blobs,
    fade,
    rods,
    smooth_step,
    turned,
    waves,
)

Points = NDArray[np.float32]


def hollow_swirl(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a hollow swirling flame: helical arms on a shell that widens upwards."""
    arms, turns = int(random.integers(2, 5)), random.uniform(0.6, 1.4)
    phase, width = random.uniform(0, 2 * np.pi), random.uniform(1.2, 1.8)
    narrow, wide = 0.25 * min(half[0], half[2]), 0.62 * min(half[0], half[2])
    drift = random.uniform(-0.12, 0.12, 2) * half[[0, 2]]

    def emission(points: Points) -> Values:
        height = points[:, 1] / np.float32(2 * half[1]) + np.float32(0.5)
        x = points[:, 0] - np.float32(drift[0]) * height
        z = points[:, 2] - np.float32(drift[1]) * height
        radius = np.hypot(x, z)
        angle = np.arctan2(z, x) * arms - height * np.float32(2 * np.pi * turns * arms / 2)
        shell = bell(radius - np.float32(narrow) - np.float32(wide - narrow) * height, width)
        light = 0.4 + 0.6 * np.square(np.cos((angle + np.float32(phase)) / 2))
        return shell * light * (1.2 - height) * fade(points, half, over=4)

    return emission


def averaged_jet(random: np.random.Generator, half: NDArray) -> Shape:
    """Return the time average of a turbulent jet: a wide, smooth plume bent by a cross flow."""
    angle, bend = random.uniform(0, 2 * np.pi), random.uniform(0.05, 0.3) * half[0]
    width, growth = random.uniform(1.8, 2.4), random.uniform(1.2, 1.9)
    flat = random.uniform(1.0, 1.4)

    def emission(points: Points) -> Values:
        height = np.clip(points[:, 1] / np.float32(2 * half[1]) + np.float32(0.5), 0, None)
        shift = np.float32(bend) * height**2
        x = points[:, 0] - np.float32(np.cos(angle)) * shift
        z = (points[:, 2] - np.float32(np.sin(angle)) * shift) * np.float32(flat)
        spread = np.float32(width) * (1 + np.float32(growth) * height)
        light = 1 / (1 + np.float32(growth) * height)
        return np.exp(-0.5 * (x * x + z * z) / spread**2) * light * fade(points, half, over=6)

    return emission


def separate_blobs(random: np.random.Generator, half: NDArray) -> Shape:
    """Return six to twelve separate round clouds of different size and brightness."""
    count = int(random.integers(6, 13))
    inside = half - 6
    return blobs(
        random.uniform(-1, 1, (count, 3)) * inside,
        random.uniform(1.2, 2.4, count),
        random.uniform(0.2, 1, count),
    )


def half_voxel_sheets(random: np.random.Generator, half: NDArray) -> Shape:
    """Return two gently curved sheets half a voxel thick, which no voxel can show as they are."""
    turns = [turned(random, 15, 60), turned(random, 15, 60)]
    bends = random.uniform(0.008, 0.02, 2) * random.choice([-1, 1], 2)
    places, lights = random.uniform(-0.25, 0.25, 2) * half[0], random.uniform(0.5, 1, 2)
    width = 0.5 / 2.355  # full width at half maximum of half a voxel

    def emission(points: Points) -> Values:
        found = np.zeros(len(points), np.float32)
        for turn, bend, place, light in zip(turns, bends, places, lights, strict=True):
            x, y, z = turn(points).T
            curved = x - np.float32(place) - np.float32(bend) * (y * y + z * z)
            slope = np.sqrt(1 + np.float32(4 * bend**2) * (y * y + z * z))
            found += np.float32(light) * bell(curved / slope, width)
        round_ = np.square(points / (0.85 * half).astype(np.float32)).sum(axis=1)
        return found * smooth_step((1 - round_) * 2)

    return emission


def branching_fingers(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a tree of discharges: a trunk that branches three times, thinner and fainter."""
    starts, ends, widths, lights = [], [], [], []
    foot = np.array([0, 6 - half[1], 0])
    tips = [(foot, np.array([0.0, 1.0, 0.0]), 0.55 * half[1], 1.5, 1.0)]
    while tips:
        start, heading, length, width, light = tips.pop()
        end = np.clip(start + length * heading, 4 - half, half - 4)
        starts.append(start), ends.append(end), widths.append(width), lights.append(light)
        if width > 0.75:
            for _ in range(int(random.integers(2, 4))):
                turn = heading + 0.75 * random.standard_normal(3)
                turn[1] = abs(turn[1]) * 0.8
                turn /= np.linalg.norm(turn)
                tips.append((end, turn, 0.68 * length, 0.75 * width, 0.72 * light))
    return rods(np.array(starts), np.array(ends), np.array(widths), np.array(lights))


def filled_box(random: np.random.Generator, half: NDArray) -> Shape:
    """Return gas that fills the grid to its faces and ends there, uneven by a half."""
    uneven = waves(random, 7, 8, 40)
    slope = random.uniform(-0.3, 0.3, 3) / half

    def emission(points: Points) -> Values:
        light = 1 + 0.35 * uneven(points) + points @ slope.astype(np.float32)
        inside = (np.abs(points) <= half.astype(np.float32)).all(axis=1)
        return np.clip(light, 0.05, None) * inside

    return emission


def cut_flame(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a wrinkled flame front with a faint tail that leaves the grid at the top."""
    wrinkle, patches = waves(random, 7, 6, 26), waves(random, 4, 8, 26)
    width, side = random.uniform(1.0, 1.5), 0.5 * min(half[0], half[2])
    base = -0.6 * half[1]

    def emission(points: Points) -> Values:
        x, y, z = points.T
        height = (y - np.float32(base)) / np.float32(1.6 * half[1])
        radius = np.hypot(x, z) - np.float32(side) * (0.75 + 0.25 * np.clip(height, 0, 1))
        front = bell(radius + 1.5 * wrinkle(points), width)
        start = smooth_step(height * 4)
        end = 1 / (1 + np.exp((y - np.float32(1.2 * half[1])) / np.float32(0.8)))
        light = np.clip(0.7 + 0.3 * patches(points), 0.05, None) * np.exp(-2.2 * height)
        return (front * start * end * light * fade(points, half, "xz")).astype(np.float32)

    return emission


def off_axis_plume(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a wide, patchy plume beside the axis that widens upwards."""
    angle, patches = random.uniform(0, 2 * np.pi), waves(random, 6, 9, 34)
    foot = (0.4 * min(half[0], half[2]) * np.array([np.cos(angle), np.sin(angle)])).astype("f4")
    width = random.uniform(1.6, 2.2)

    def emission(points: Points) -> Values:
        height = points[:, 1] / np.float32(2 * half[1]) + np.float32(0.5)
        square = (points[:, 0] - foot[0]) ** 2 + (points[:, 2] - foot[1]) ** 2
        density = np.clip(0.75 + 0.35 * patches(points), 0.05, None)
        spread = np.float32(width) * (1 + np.clip(height, 0, 1))
        return np.exp(-0.5 * square / spread**2) * density * fade(points, half)

    return emission


def fine_ripples(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a round cloud whose density changes by a half over one to two and a half voxels."""
    ripple, middle = waves(random, 40, 1.0, 2.5), random.uniform(-0.15, 0.15, 3) * half

    def emission(points: Points) -> Values:
        away = (points - middle.astype(np.float32)) / (0.65 * half).astype(np.float32)
        round_ = smooth_step(2 * (1 - np.square(away).sum(axis=1)))
        return round_ * np.clip(1 + 0.5 * ripple(points), 0, None) * fade(points, half)

    return emission
