"""Solids given as triangles, and the nearest triangle ahead of rays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled
from rigs.scene.surfaces import TRIANGLE, Glass, Material, face, scaled_material
from rigs.scene.tracing import into_box

if TYPE_CHECKING:
    import open3d as o3d

LARGEST = 4_000_000
"""Triangles of a mesh: as many take 1.5 GB in Open3D's tree of boxes. A coarser mesh serves."""

_AHEAD = 1e-5
"""Diameters of a mesh that a ray moves on from a triangle before the next: Open3D rounds
coordinates to 1e-7 of the mesh. A wall thinner than this would be missed."""

_SAMPLES = 2000
"""Points on a mesh that are looked up in other solids."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A solid of triangles.

    Parameters
    ----------
    name : str
    vertices : (V, 3) array_like
    triangles : (T, 3) array_like
        Vertices of each triangle, counter-clockwise seen from outside.
    material : Material
        Glass needs a closed mesh.
    smooth : bool
        Whether light meets normals interpolated between vertices: for curved glass.
    source : str
        The file it was read from.

    Raises
    ------
    ValueError
        If there is no triangle, there are too many, a mesh of glass is not closed, or its
        normals point inward.
    """

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    material: Material
    smooth: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        """Check the triangles."""
        vertices = np.ascontiguousarray(self.vertices, np.float64)
        triangles = np.ascontiguousarray(self.triangles, np.int64)
        what = f"solid {self.name}"
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
            raise ValueError(f"{what}: vertices: expected finite coordinates, three a vertex")
        if triangles.ndim != 2 or triangles.shape[1:] != (3,) or not len(triangles):
            raise ValueError(f"{what}: found no triangle, expected a mesh of at least one")
        if len(triangles) > LARGEST:
            raise ValueError(
                f"{what}: found {len(triangles)} triangles (some "
                f"{len(triangles) * 380 / 1e9:.1f} GB), expected at most {LARGEST}: simplify it"
            )
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"{what}: triangles: found {triangles.max()}, expected vertices")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)
        area = np.linalg.norm(self._crosses, axis=1)
        if not (area > 0).all():
            kept = triangles[area > 0]  # a triangle of no area is met by no ray
            object.__setattr__(self, "triangles", kept)
            self.__dict__.pop("_crosses")
            if not len(kept):
                raise ValueError(f"{what}: found no triangle with an area, expected a surface")
        if not isinstance(self.material, Glass):
            return
        if not self.is_closed:
            raise ValueError(
                f"{what}: found a mesh with open edges, expected a closed one for glass: fill its "
                "holes, or make it opaque"
            )
        if self.volume < 0:
            raise ValueError(f"{what}: found normals inward, expected outward: flip the faces")

    def __repr__(self) -> str:
        """Name the sizes; the arrays are too long to print."""
        return f"<Mesh {self.name}: {len(self.triangles)} triangles, {self.material!r}>"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        return (self.name, self.material, self.smooth) == (
            other.name, other.material, other.smooth,
        ) and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("vertices", "triangles")
        )  # fmt: skip

    def __hash__(self) -> int:
        return hash((self.name, self.material, len(self.triangles)))

    def __getstate__(self) -> dict:
        """Return the fields: what Open3D made of them cannot be sent to another process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def what(self) -> str:
        """How messages call the solid."""
        return f"solid {self.name}"

    @cached_property
    def _crosses(self) -> NDArray[np.float64]:
        """Twice the area of each triangle along its normal, ``(T, 3)``."""
        a, b, c = self.vertices[self.triangles.T]
        return np.cross(b - a, c - a)

    @cached_property
    def is_closed(self) -> bool:
        """Whether every edge has a triangle on each side, in opposite orders."""
        points, first = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = first.ravel()[self.triangles]  # vertices of one place count as one
        edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
        forward = np.sort(edges @ np.array([len(points), 1]))
        backward = np.sort(edges @ np.array([1, len(points)]))
        return bool(np.array_equal(forward, backward) and (np.diff(forward) > 0).all())

    @property
    def volume(self) -> float:
        """Its volume; negative where normals point inward."""
        a = self.vertices[self.triangles[:, 0]] - self.vertices.mean(axis=0)
        return float((a * self._crosses).sum() / 6)

    @cached_property
    def diameter(self) -> float:
        """The diagonal of its box."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def faces(self, medium: float) -> NDArray:
        """Return the row that stands for its triangles; see `Solid`."""
        return face(TRIANGLE, self.material, self.vertices[0], front=(medium, 0.0))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are inside; none is inside an open mesh. See `Solid`."""
        if not self.is_closed:
            return np.zeros(len(points), bool)
        import open3d as o3d

        local = (points - self.vertices.mean(axis=0)).astype(np.float32)
        inside = self._caster.compute_occupancy(o3d.core.Tensor.from_numpy(local), nsamples=3)
        return inside.numpy() > 0.5

    def samples(self) -> NDArray[np.float64]:
        """Return the middles of triangles, of every k-th where they are many; see `Solid`."""
        step = -(-len(self.triangles) // _SAMPLES)
        return self.vertices[self.triangles[::step]].mean(axis=1)

    @cached_property
    def _caster(self) -> o3d.t.geometry.RaycastingScene:
        """Open3D's scene of the triangles, in float32 about their mean."""
        import open3d as o3d

        caster = o3d.t.geometry.RaycastingScene()
        caster.add_triangles(
            o3d.core.Tensor.from_numpy(
                (self.vertices - self.vertices.mean(axis=0)).astype(np.float32)
            ),
            o3d.core.Tensor.from_numpy(self.triangles.astype(np.uint32)),
        )
        # the first cast builds the tree: threads that share the scene must find it built
        caster.cast_rays(o3d.core.Tensor.from_numpy(np.array([[0, 0, 0, 1, 0, 0]], np.float32)))
        return caster

    @cached_property
    def _vertex_normals(self) -> NDArray[np.float64]:
        """Unit normals at vertices, ``(V, 3)``.

        Means over triangles, each normal over the product of its edges' squared lengths: exact
        for vertices on a sphere (Max, "Weights for computing vertex normals", 1999).
        """
        total = np.zeros_like(self.vertices)
        corners = self.vertices[self.triangles]  # (T, 3 corners, 3)
        squares = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2)  # of edges, (T, 3)
        for corner in range(3):
            weight = 1 / (squares[:, corner] * squares[:, corner - 1])
            np.add.at(total, self.triangles[:, corner], weight[:, None] * self._crosses)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return total / np.where(length > 0, length, 1)

    def nearest(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        leaves: NDArray[np.bool_],
        within: NDArray[np.float64],
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the rays that meet a triangle ``(M,)``, how far away, and the unit normal there.

        ``leaves`` ``(N,)`` says whether a ray comes from this mesh, ``within`` ``(N,)`` how far
        ahead something is in the way already. Origins are moved in float64 to the mesh's box, for
        Open3D computes in float32; the distance to the triangle that it finds is then computed in
        float64.
        """
        import open3d as o3d

        ahead = np.zeros(len(origins))
        _to_box(origins, directions, self.box, within, ahead)
        rays = np.flatnonzero(np.isfinite(ahead))
        if not len(rays):
            return rays, np.zeros(0), np.zeros((0, 3))
        start = ahead[rays] + np.where(leaves[rays], _AHEAD * self.diameter, 0.0)
        near = origins[rays] + start[:, None] * directions[rays] - self.vertices.mean(axis=0)
        lines = np.concatenate([near, directions[rays]], axis=1).astype(np.float32)
        cast = self._caster.cast_rays(o3d.core.Tensor.from_numpy(lines))
        triangle = cast["primitive_ids"].numpy().astype(np.int64)
        met = triangle < len(self.triangles)  # a miss is the largest number
        rays, triangle = rays[met], triangle[met]
        normals = self._crosses[triangle]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        corner = self.vertices[self.triangles[triangle, 0]]
        toward = np.einsum("ij,ij->i", directions[rays], normals)
        height = np.einsum("ij,ij->i", corner - origins[rays], normals)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = height / toward
        if self.smooth:
            normals = self._smooth_normals(triangle, cast["primitive_uvs"].numpy()[met], toward)
        ahead = (distance > 0) & (distance < within[rays])  # NaN for a ray along a triangle
        return rays[ahead], distance[ahead], normals[ahead]

    def _smooth_normals(
        self, triangle: NDArray[np.int64], uv: NDArray[np.float32], toward: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return normals interpolated in triangles, facing as the triangle does, ``(M, 3)``."""
        corners = self._vertex_normals[self.triangles[triangle]]  # (M, 3 corners, 3)
        u, v = uv.astype(np.float64).T
        shares = np.stack([1 - u - v, u, v], axis=1)
        normals = np.einsum("ij,ijk->ik", shares, corners)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """Lower and upper corner, wider by what float32 rounds, ``(2, 3)``."""
        margin = _AHEAD * self.diameter
        return np.stack([self.vertices.min(axis=0) - margin, self.vertices.max(axis=0) + margin])

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the mesh after the motion ``x_new = R @ x_old + t``."""
        return replace(self, vertices=self.vertices @ R.T + t)

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the mesh of a world whose lengths are ``factor`` times as large."""
        material = scaled_material(self.material, factor)
        return replace(self, vertices=self.vertices * factor, material=material)


@compiled
def _to_box(origins, directions, box, within, ahead) -> None:
    """Write how far ahead each ray enters a box, infinity where it does not before ``within``."""
    for n in range(len(ahead)):
        ahead[n] = into_box(origins[n], directions[n], within[n], box)
