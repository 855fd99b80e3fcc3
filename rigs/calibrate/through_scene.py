"""The joint adjustment of targets that are seen through a scene: windows, tubes, water behind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.culling import adjust_and_cull, adjust_robustly, noise
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    camera_rows,
    predicted,
    world_points,
)
from rigs.calibrate.adjust.observation_arrays import Scene as Unknowns
from rigs.calibrate.joint_adjustment import Adjusted
from rigs.calibrate.observations import Observations
from rigs.calibrate.refraction.refraction import Refraction, WindowPrior
from rigs.calibrate.refraction.routes import HIDDEN, PASSES, REFLECTED, routes_to, widened
from rigs.calibrate.refraction.start import likely_route, start_before_media
from rigs.rig import Rig
from rigs.scene.scene import Scene
from rigs.scene.surfaces import Glass

_ROUNDS = 12  # of placing the scene in the world; each moves it some tenth of the one before
_SETTLED = 1e-8  # target sizes: motion of cameras in the world below which the scene is in place
_ROUGHLY_SETTLED = 1e-3  # the same where lenses and poses are found anew afterwards
_NOISE_SETTLED = 0.02  # relative change of the noise, by which priors weigh


@dataclass(frozen=True)
class Through:
    """A scene to look through, in the rig's world and unit, and how it is placed and adjusted."""

    scene: Scene
    priors: Sequence[WindowPrior]  # of the windows that are adjusted
    placed: Callable[[Unknowns], Unknowns]  # in the rig's world, in target sizes
    scale: float  # the target's size
    held: int | None  # the camera whose axes are the world's, if one's are


def adjust_through(
    through: Through,
    together: Callable[..., Adjusted],
    observations: Observations,
    kept: NDArray[np.int64],
    intrinsics: Rig | None,
    cull: bool,
    report: Callable[[str], None],
) -> Adjusted:
    """Return the joint adjustment through a scene; the unknowns are in the rig's world.

    It starts from an adjustment ``together`` as if nothing were in the way. After a first one
    through the scene its effect is taken out of the observations: lens terms are then chosen, and
    lenses and poses found anew, as without a scene. The last adjustment takes the observations as
    they are.
    """
    names = observations.cameras
    # A given lens fits nothing behind water until the water is there
    start = None if _has_other_media(through.scene) else intrinsics
    first = together(observations, kept, intrinsics=start)
    report("scene")
    rough = _through(through, first, names, cull)
    straight = predicted(replace(rough.scene, refraction=None), rough.arrays)
    bent = predicted(rough.scene, rough.arrays)
    known = np.asarray(np.isfinite(straight - bent).all(axis=1))
    for camera, name in enumerate(names):
        own = rough.arrays.camera == camera
        if own.any() and not known[own].any():
            raise ValueError(_unreached(name, "totally reflected"))
    uv = observations.uv.copy()
    uv[rough.rows[known]] += (straight - bent)[known]
    second = together(replace(observations, uv=uv), rough.rows[known], intrinsics=intrinsics)
    report("joint adjustment through the scene")
    arrays = replace(second.arrays, uv=observations.uv[second.rows])
    found = _through(through, replace(second, arrays=arrays), names, cull, rough.scene.refraction)
    _check_scene_is_met(found, names)
    return found


def looked_through(adjusted: Adjusted, cameras: int) -> list[list[str]]:
    """Return the names of the solids that each camera sees the target through."""
    bending, routes = _refraction(adjusted.scene), adjusted.arrays.routes
    assert routes is not None  # `_through` found them
    found = []
    for camera in range(cameras):
        own = np.unique(routes[(adjusted.arrays.camera == camera) & adjusted.used])
        solids = np.unique(bending.faces["solid"][own[own >= 0]])
        found.append([bending.scene.solids[number].name for number in solids])
    return found


def _through(
    through: Through,
    adjusted: Adjusted,
    names: tuple[str, ...],
    cull: bool,
    refraction: Refraction | None = None,
) -> Adjusted:
    """Return an adjustment from the start of another one, through the scene.

    A world that is no camera's moves with the unknowns: both are repeated until nothing moves.
    """
    is_start = refraction is None
    if refraction is None:
        scale = through.scale
        given = through.scene.with_lengths_scaled(1 / scale)
        priors = tuple(
            replace(prior, distance=prior.distance / scale, thickness=prior.thickness / scale)
            for prior in through.priors
        )
        refraction = Refraction.of(given, priors)
    root = adjusted.root if through.held is None else through.held
    free = refraction.deviations > 0
    is_adjusted = bool(free.any())
    freedom = replace(
        adjusted.freedom,
        pose=np.arange(len(names)) != root,
        time=None,  # the moments of images are as found without the scene
        windows=free,
    )
    # Velocities go with the moments
    arrays = replace(adjusted.arrays, velocity=None, routes=None)
    scene = through.placed(replace(adjusted.scene, offset=None))
    if is_start:
        for name, center in zip(names, scene.centers(), strict=True):
            refraction.scene.check_outside(center, f"camera {name}")
        scene = start_before_media(scene, arrays, refraction, through.held)
        scene = through.placed(scene)
    scene = replace(scene, refraction=refraction)
    used, sigma = np.ones(len(arrays), bool), np.nan
    routes: NDArray[np.int64] | None = None
    settled, rounds = (_ROUGHLY_SETTLED, 3) if is_start else (_SETTLED, _ROUNDS)
    for _ in range(rounds):
        before, previous = sigma, routes
        routes = _routes(scene, arrays, names, roughly=is_start)
        arrays = replace(arrays, routes=routes)
        if is_start:
            used = np.asarray(np.isfinite(predicted(scene, arrays)).all(axis=1))
            solution = adjust_robustly(scene, arrays.where(used), freedom, tolerance=1e-3)
        elif previous is None or not np.array_equal(routes, previous):
            kept = adjust_and_cull(scene, arrays, freedom, cull)
            solution, used = kept.solution, kept.used
        else:
            solution = adjust(scene, arrays.where(used), freedom)
        sigma = float(noise(solution.residuals, np.zeros(int(used.sum()), np.int64), 1)[0])
        scene = through.placed(solution.scene)
        scene = replace(scene, refraction=replace(_refraction(scene), noise=sigma))
        moved = np.abs(scene.centers() - solution.scene.centers()).max()
        weighs = not is_adjusted or abs(sigma - before) <= _NOISE_SETTLED * sigma
        if (
            moved < settled
            and weighs
            and np.array_equal(routes, _routes(scene, arrays, names, roughly=is_start))
        ):
            break
    return replace(adjusted, scene=scene, arrays=arrays, used=used, freedom=freedom, root=root)


def _refraction(scene: Unknowns) -> Refraction:
    """Return what bends the light, of unknowns that are seen through a scene."""
    assert scene.refraction is not None
    return scene.refraction


def _routes(
    scene: Unknowns, arrays: ObservationArrays, names: tuple[str, ...], roughly: bool = False
) -> NDArray[np.int64]:
    """Return the faces that each observation is seen through ``(N, R)``; raise if light is lost.

    ``roughly`` takes those to the middle of what a camera saw, where only starts are known.
    """
    refraction = _refraction(scene)
    centers, points = scene.centers(), world_points(scene, arrays)
    routes, ends = np.full((len(arrays), 1), -1), np.zeros(len(arrays), np.int64)
    for camera, rows in camera_rows(arrays):
        refraction.scene.check_outside(centers[camera], f"camera {names[camera]}")
        found, ends[rows] = routes_to(refraction, centers[camera], points[rows])
        if roughly:
            middle = np.nanmean(points[rows], axis=0)
            route = likely_route(refraction, centers[camera], middle)
            found = np.tile(route, (len(found), 1))
            ends[rows] = PASSES
        width = max(routes.shape[1], found.shape[1])
        routes = widened(routes, width)
        routes[rows] = widened(found, width)
        for end, cause in ((REFLECTED, "totally reflected"), (HIDDEN, "stopped by hardware")):
            if (ends[rows] == end).all():
                raise ValueError(_unreached(names[camera], cause))
    return routes


def _unreached(camera: str, cause: str) -> str:
    """Return a line on a camera that no light of the target reaches."""
    return (
        f"camera {camera}: light of all target points is {cause} in the scene, expected a way to "
        "the camera: check the scene's poses and indices, its world (--world) and its unit"
    )


def _check_scene_is_met(adjusted: Adjusted, names: tuple[str, ...]) -> None:
    """Raise if no camera looks through glass of a scene that has some, or through one adjusted."""
    through = {name for own in looked_through(adjusted, len(names)) for name in own}
    glass = [
        s.name for s in _refraction(adjusted.scene).scene.solids if isinstance(s.material, Glass)
    ]
    lost = [name for name in adjusted.scene.windows if name not in through]
    if lost or (glass and not through):
        raise ValueError(
            f"scene: solid {(lost or glass)[0]}: found between no camera and the target, expected "
            "some to look through it: check its pose, the world it is in (--world) and its unit"
        )


def _has_other_media(scene: Scene) -> bool:
    """Return whether something else than the cameras' medium is behind glass."""
    behind = [
        getattr(solid, name, None) for solid in scene.solids for name in ("beyond", "inside")
    ]
    return any(index not in (None, scene.medium) for index in behind)
