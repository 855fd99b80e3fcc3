"""Families of fields that rules are settled on; lengths in voxels from the grid's middle.

Each takes a random generator and the grid's half edges ``(3,)``, and returns its emission.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.scenes.shapes import Shape, Values, bell, blobs, fade, rods, turned, waves

Points = NDArray[np.float32]


def tilted_cone(random: np.random.Generator, half: NDArray) -> Shape:
    """Return the thin shell of a Bunsen flame's cone, tilted, brighter on one side."""
    turn = turned(random, 8, 22)
    tip, base = 0.62 * half[1], -0.72 * half[1]
    slope = 0.62 * min(half[0], half[2]) / (tip - base)
    width, side = random.uniform(1.1, 1.6), random.uniform(0, 2 * np.pi)

    def emission(points: Points) -> Values:
        x, y, z = turn(points).T
        radius = np.sqrt(x * x + z * z + np.float32(0.3))
        away = (radius - (tip - y) * np.float32(slope)) / np.float32(np.hypot(1, slope))
        light = 1 + 0.35 * np.cos(np.arctan2(z, x) - np.float32(side))
        ends = 1 / (1 + np.exp((base - y) / np.float32(0.8)))
        return bell(away, width) * light * ends * fade(points, half)

    return emission


def interacting_jets(random: np.random.Generator, half: NDArray) -> Shape:
    """Return two or three round jets from below that lean towards each other, with puffs."""
    count = int(random.integers(2, 4))
    angles = random.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
    feet = 0.5 * min(half[0], half[2]) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    widths, lengths = random.uniform(1.4, 2.2, count), random.uniform(7, 12, count)
    phases, lights = random.uniform(0, 2 * np.pi, count), random.uniform(0.5, 1, count)

    def emission(points: Points) -> Values:
        height = (points[:, 1] + np.float32(half[1])) / np.float32(2 * half[1])
        found = np.zeros(len(points), np.float32)
        for foot, width, length, phase, light in zip(
            feet, widths, lengths, phases, lights, strict=True
        ):
            lean = 1 - 0.9 * height
            square = (points[:, 0] - lean * np.float32(foot[0])) ** 2
            square += (points[:, 2] - lean * np.float32(foot[1])) ** 2
            spread = np.float32(width) * (1 + 0.8 * height)
            puffs = 1 + 0.4 * np.cos(points[:, 1] * np.float32(2 * np.pi / length) + phase)
            found += np.float32(light) * puffs * np.exp(-0.5 * square / spread**2) / (1 + height)
        return found * fade(points, half, over=5)

    return emission


def sparks(random: np.random.Generator, half: NDArray) -> Shape:
    """Return glowing grains narrower than two voxels, of unlike brightness, and streaks."""
    grains, streaks = int(random.integers(30, 55)), int(random.integers(4, 9))
    inside = half - 2.5
    centres = random.uniform(-1, 1, (grains, 3)) * inside
    points_of = blobs(
        centres, random.uniform(0.4, 0.8, grains), np.exp(random.normal(-0.5, 0.7, grains))
    )
    middles = random.uniform(-0.8, 0.8, (streaks, 3)) * inside
    steps = random.uniform(-1, 1, (streaks, 3)) * 0.18 * inside
    streaks_of = rods(
        middles - steps, middles + steps, np.full(streaks, 0.5), random.uniform(0.2, 0.6, streaks)
    )
    return lambda points: points_of(points) + streaks_of(points)


def smoke_sheets(random: np.random.Generator, half: NDArray) -> Shape:
    """Return two or three wrinkled sheets of smoke about two voxels thick, of patchy density."""
    count = int(random.integers(2, 4))
    turn = turned(random, 0, 35)
    wrinkle, patches = waves(random, 6, 9, 34), waves(random, 5, 8, 30)
    places = (np.arange(count) - (count - 1) / 2) * 1.3 * half[0] / count
    width = random.uniform(0.7, 1.0)

    def emission(points: Points) -> Values:
        turned_points = turn(points)
        bent = turned_points[:, 0] + np.float32(1.8) * wrinkle(points)
        found = sum(bell(bent - np.float32(place), width) for place in places)
        density = np.clip(0.6 + 0.45 * patches(points), 0.05, None)
        round_ = np.square(points[:, 1:] / half[1:].astype(np.float32)).sum(axis=1)
        return found * density * np.clip(1.1 - round_, 0, 1) * fade(points, half)

    return emission


def core_with_halo(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a narrow core and, a thousand times fainter, a halo that fills most of the grid."""
    core = random.uniform(-0.15, 0.15, 3) * half
    middle = random.uniform(-0.1, 0.1, 3) * half
    width, ripple = random.uniform(1.5, 2.2), waves(random, 4, 9, 30)
    ratio = 1e-3

    def emission(points: Points) -> Values:
        square = np.square(points - core.astype(np.float32)).sum(axis=1)
        bright = np.exp(square * np.float32(-0.5 / width**2))
        shell = np.square((points - middle) / (0.75 * half)).sum(axis=1).astype(np.float32)
        faint = np.clip(1 - shell, 0, None) ** 0.5 * (1 + 0.3 * ripple(points))
        return bright + np.float32(ratio) * np.clip(faint, 0, None) * fade(points, half)

    return emission


def cut_column(random: np.random.Generator, half: NDArray) -> Shape:
    """Return a meandering column of puffs that leaves the grid at the top and goes on above it."""
    base = -0.7 * half[1]
    length, phase = random.uniform(9, 14), random.uniform(0, 2 * np.pi, 3)
    width, sway = random.uniform(2.0, 3.0), 0.16 * min(half[0], half[2])
    ripple = waves(random, 6, 6, 20)

    def emission(points: Points) -> Values:
        x, y, z = points.T
        turn = y * np.float32(2 * np.pi / (2.4 * length))
        square = (x - sway * np.sin(turn + phase[0])) ** 2 + (z - sway * np.cos(turn)) ** 2
        puffs = 1 + 0.35 * np.cos(y * np.float32(2 * np.pi / length) + phase[1])
        spread = np.float32(width) * (1 + 0.012 * (y - base)) * (1 + 0.12 * ripple(points))
        start = 1 / (1 + np.exp((base - y) / np.float32(1.2)))
        end = 1 / (1 + np.exp((y - np.float32(1.25 * half[1])) / np.float32(0.8)))
        column = np.exp(-0.5 * square / spread**2) * puffs * start * end
        return (column * fade(points, half, "xz")).astype(np.float32)

    return emission


def vortex_rings(random: np.random.Generator, half: NDArray) -> Shape:
    """Return two or three tilted rings of gas above each other, with thin cores."""
    count = int(random.integers(2, 4))
    turns = [turned(random, 5, 40) for _ in range(count)]
    heights = (np.arange(count) - (count - 1) / 2) * 1.25 * half[1] / count
    radii = random.uniform(0.4, 0.62, count) * min(half[0], half[2])
    widths, lights = random.uniform(0.9, 1.7, count), random.uniform(0.4, 1, count)
    sides = random.uniform(0, 2 * np.pi, count)

    def emission(points: Points) -> Values:
        found = np.zeros(len(points), np.float32)
        for turn, height, radius, width, light, side in zip(
            turns, heights, radii, widths, lights, sides, strict=True
        ):
            x, y, z = turn(points - np.array([0, height, 0], np.float32)).T
            away = np.hypot(np.hypot(x, z) - np.float32(radius), y)
            uneven = 1 + 0.3 * np.cos(np.arctan2(z, x) - np.float32(side))
            found += np.float32(light) * uneven * bell(away, width)
        return found * fade(points, half)

    return emission


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
