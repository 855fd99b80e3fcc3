"""Families of either half without a fault that look like one.

Flames that half of the views of a narrow rig cut, and flames with detail that no view resolves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.scenes.shapes import Shape, Values, bell, fade, smooth_step, turned, waves

Points = NDArray[np.float32]


def off_axis_cone(random: np.random.Generator, half: NDArray) -> Shape:
    """Return the shell of a tall cone beside the axis, brighter on one side."""
    angle, side = random.uniform(0, 2 * np.pi, 2)
    foot = (0.4 * min(half[0], half[2]) * np.array([np.cos(angle), np.sin(angle)])).astype("f4")
    tip, base, width = 0.88 * half[1], -0.85 * half[1], random.uniform(1.1, 1.6)
    slope = 0.5 * min(half[0], half[2]) / (tip - base)

    def emission(points: Points) -> Values:
        x, y, z = points[:, 0] - foot[0], points[:, 1], points[:, 2] - foot[1]
        away = np.hypot(x, z) - (tip - y) * np.float32(slope)
        light = 1 + 0.3 * np.cos(np.arctan2(z, x) - np.float32(side))
        ends = 1 / (1 + np.exp((base - y) / np.float32(0.8)))
        ends /= 1 + np.exp((y - np.float32(tip)) / np.float32(0.8))
        return (bell(away, width) * light * ends * fade(points, half)).astype(np.float32)

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


def fine_wrinkles(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a flame front whose wrinkles are one to two and a half voxels long."""
    turn, wrinkle = turned(random, 5, 25), waves(random, 40, 1.0, 2.5)
    radius, width = 0.5 * min(half[0], half[2]), random.uniform(0.8, 1.1)

    def emission(points: Points) -> Values:
        x, y, z = turn(points).T
        stretched = np.sqrt(x * x + z * z + np.square(y * np.float32(radius / (0.7 * half[1]))))
        front = bell(stretched - np.float32(radius) + np.float32(0.6) * wrinkle(points), width)
        return front * fade(points, half)

    return emission


def fine_ripples(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a round cloud whose density changes by a half over one to two and a half voxels."""
    ripple, middle = waves(random, 40, 1.0, 2.5), random.uniform(-0.15, 0.15, 3) * half

    def emission(points: Points) -> Values:
        away = (points - middle.astype(np.float32)) / (0.65 * half).astype(np.float32)
        round_ = smooth_step(2 * (1 - np.square(away).sum(axis=1)))
        return round_ * np.clip(1 + 0.5 * ripple(points), 0, None) * fade(points, half)

    return emission
