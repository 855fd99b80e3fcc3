"""A scene to draw: named, coloured triangle meshes and labels in world coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float]


def rgb(colour: str) -> Colour:
    """Return ``"#rrggbb"`` as three numbers in 0..1."""
    return as_colour(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))


def as_colour(numbers: Iterable[float]) -> Colour:
    """Return three numbers in 0..1 as a colour."""
    red, green, blue = numbers
    return red, green, blue


def css(colour: Colour) -> str:
    """Return the colour as CSS."""
    return "rgb({:.0f},{:.0f},{:.0f})".format(*(255 * c for c in colour))


def on_black(colour: Colour) -> Colour:
    """Return a colour made for white paper as it is seen as well on black: lighter, if dark."""
    luminance = 0.3 * colour[0] + 0.59 * colour[1] + 0.11 * colour[2]
    if luminance >= 0.55:
        return colour
    white = (0.55 - luminance) / (1 - luminance)
    return as_colour(round(c + white * (1 - c), 3) for c in colour)


@dataclass(frozen=True)
class ColourScale:
    """The colour scale of a quantity: words with unit, the numbers at both ends, a colour map."""

    title: str
    lower: float
    upper: float
    colours: str = "viridis"

    @classmethod
    def of(cls, title: str, values: NDArray, colours: str = "viridis") -> ColourScale:
        """Return the scale that spans the finite values; a single value is at its middle."""
        finite = values[np.isfinite(values)]
        lower, upper = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        if upper - lower <= 1e-3 * max(abs(lower), abs(upper)):
            aside = 0.1 * max(abs(lower), abs(upper)) or 1.0
            lower, upper = lower - aside, upper + aside
        return cls(title, lower, upper, colours)

    def __call__(self, values: NDArray) -> NDArray[np.float64]:
        """Return red, green, blue in 0..1 of each value, ``(..., 3)``; NaN is grey."""
        from matplotlib import colormaps

        values = np.asarray(values, np.float64)
        ratio = (values - self.lower) / (self.upper - self.lower)
        colours = np.array(colormaps[self.colours](np.nan_to_num(np.clip(ratio, 0, 1))))[..., :3]
        return np.where(np.isfinite(values)[..., None], colours, 0.8)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh of one colour, or coloured by a number at every vertex.

    Attributes
    ----------
    name : str
        The object shown, for example a camera's name.
    group : str
        The layer that switches it on and off, for example ``"cameras"``.
    vertices : (V, 3) float64
        World coordinates.
    triangles : (T, 3) int
        Vertex indices.
    colour : (3,) tuple
        Red, green, blue in 0..1.
    values : (V,) float, optional
        Numbers shown as colours of ``scale``; such a mesh is drawn without shading.
    """

    name: str
    group: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.integer]
    colour: Colour
    opacity: float = 1.0
    values: NDArray[np.floating] | None = None
    scale: ColourScale | None = None

    def __repr__(self) -> str:
        """Return name, group and size; the arrays are too long to print."""
        return f"<Mesh {self.name!r} of {self.group!r}: {len(self.triangles)} triangles>"

    @property
    def vertex_colours(self) -> NDArray[np.float64] | None:
        """Colours of the vertices ``(V, 3)`` by their values; None where the mesh has one."""
        return None if self.scale is None or self.values is None else self.scale(self.values)

    def normals(self) -> NDArray[np.float64]:
        """Return unit vertex normals ``(V, 3)``: the area-weighted means of the faces around.

        A vertex of faces without area, like the tip of a cone, has z: glTF knows no normal of
        length zero.
        """
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        faces = np.cross(b - a, c - a)  # twice the area times the normal
        sums = np.zeros_like(self.vertices)
        for i in range(3):
            np.add.at(sums, self.triangles[:, i], faces)
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.where(lengths > 0, sums, [0.0, 0.0, 1.0]) / np.where(lengths > 0, lengths, 1.0)

    def merged(self, other: Mesh) -> Mesh:
        """Return both meshes as one, with this one's name and looks."""
        values = None
        if self.values is not None and other.values is not None:
            values = np.concatenate([self.values, other.values])
        return replace(
            self,
            values=values,
            vertices=np.concatenate([self.vertices, other.vertices]),
            triangles=np.concatenate([self.triangles, other.triangles + len(self.vertices)]),
        )


@dataclass(frozen=True, eq=False)
class Label:
    """A text at a point, moved by ``outward`` from the object that it names.

    ``position`` and ``outward`` are (3,) float64 of the world. Still pictures use only the
    direction of ``outward``, and a distance in pixels.
    """

    text: str
    group: str
    position: NDArray[np.float64]
    outward: NDArray[np.float64]
    colour: Colour = (0.11, 0.15, 0.2)


@dataclass(frozen=True, eq=False)
class Scene:
    """Meshes and labels in one world, the input of the three writers."""

    meshes: tuple[Mesh, ...] = ()
    labels: tuple[Label, ...] = ()
    length_unit: str = "mm"

    def __add__(self, other: Scene) -> Scene:
        """Return the scene with the meshes and labels of both."""
        return replace(self, meshes=self.meshes + other.meshes, labels=self.labels + other.labels)

    def on_black(self) -> Scene:
        """Return the scene in colours that are seen on black."""
        return replace(
            self,
            meshes=tuple(replace(one, colour=on_black(one.colour)) for one in self.meshes),
            labels=tuple(replace(one, colour=on_black(one.colour)) for one in self.labels),
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups, in order of appearance."""
        parts: list[Mesh | Label] = [*self.meshes, *self.labels]
        return tuple(dict.fromkeys(part.group for part in parts))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of all meshes, ``(2, 3)``."""
        if not self.meshes:
            raise ValueError("scene: found no mesh, expected at least one to have bounds")
        vertices = np.concatenate([mesh.vertices for mesh in self.meshes])
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def only(self, groups: Iterable[str]) -> Scene:
        """Return the parts that belong to ``groups``."""
        wanted = set(groups)
        return replace(
            self,
            meshes=tuple(mesh for mesh in self.meshes if mesh.group in wanted),
            labels=tuple(label for label in self.labels if label.group in wanted),
        )

    def without(self, *groups: str) -> Scene:
        """Return the parts that belong to none of ``groups``."""
        return self.only(set(self.groups) - set(groups))
