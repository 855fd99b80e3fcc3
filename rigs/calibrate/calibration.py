"""From observations of a flat target to a calibrated rig."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from rigs.calibrate.adjust.lens_choice import LensRules
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.adjust.world import in_world
from rigs.calibrate.joint_adjustment import adjust_together
from rigs.calibrate.observations import Observations, without_repeats
from rigs.calibrate.options import (
    check_common_sizes,
    check_lens_options,
    check_options,
    common_lenses,
)
from rigs.calibrate.quality.assessment import assessment, findings
from rigs.calibrate.quality.covariance import labels, refuse_unknown_lenses
from rigs.calibrate.quality.ignored_glass import ignored_glass
from rigs.calibrate.quality.quality import measure
from rigs.calibrate.quality.windows import AdjustedWindow, adjusted_windows, window_findings
from rigs.calibrate.refraction.refraction import WindowPrior
from rigs.calibrate.result import Calibration, summary
from rigs.calibrate.through_scene import Through, adjust_through, looked_through
from rigs.camera import Camera
from rigs.files.text import some
from rigs.files.units import in_unit
from rigs.rig import Rig, Volume
from rigs.scene.entry import check_scene
from rigs.scene.scene import Scene as OpticalScene
from rigs.scene.scene_camera import own_camera


def calibrate(
    observations: Observations,
    *,
    intrinsics: Rig | None = None,
    world: str | Mapping[str, ArrayLike] | None = None,
    rescale: bool = False,
    length_unit: str = "mm",
    distortion: str = "auto",
    target: object | None = None,
    volume: Volume | None = None,
    cull: bool = True,
    square_pixels: bool = False,
    fixed_center: bool = False,
    common_lens: Iterable[Collection[str]] = (),
    times: Mapping[str, float] | None = None,
    scene: OpticalScene | None = None,
    windows: Sequence[WindowPrior] = (),
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Return the rig that explains the observations best, and how far it can be trusted.

    Each camera's lens is found from its own images, poses follow along the tree of shared views,
    then lenses, camera poses and target poses are adjusted together to least squared residuals.
    Outlier observations and images are left out and listed.

    Parameters
    ----------
    observations : Observations
    intrinsics : Rig, optional
        Cameras of the same names whose lenses are kept as they are.
    world : str or mapping of str to (3,) array_like, optional
        World axes of the rig. A camera's or frame's name takes the axes of that camera, or of the
        target in that frame. A mapping gives positions of at least three cameras' centres or
        targets' points (0, 0, 0) by name, met in the least-squares sense. By default the axes of
        the first camera.
    rescale : bool
        Let the positions in ``world`` set the scale instead of the target.
    length_unit : str
        Unit of the target's lengths, and so of the rig; with ``rescale`` that of the positions.
    distortion : str
        Free terms of the lenses: "none", "radial" (k1 k2), "brown4", "brown5", "rational",
        "thin_prism", "tilted", "fisheye". "auto" chooses for each camera up to "rational": first
        by cross-validation over frames, then by the joint adjustment.
    target : object, optional
        The target that was seen. Its ``ambiguity``, a text, says why its pose has several answers.
    volume : Volume, optional
        Where ray-miss is evaluated, in the rig's world; by default where the target was. It is
        kept in the rig.
    cull : bool
        Leave out outliers; False keeps every observation.
    square_pixels : bool
        Hold fx equal to fy.
    fixed_center : bool
        Hold the principal point in the middle of the image.
    common_lens : iterable of collections of str
        Sets of cameras; those of one set share camera matrix and distortion.
    times : mapping of str to float, optional
        Moments of frames of films, counted in frames (`frame_times`). Where the target moves
        smoothly, cameras that are out of step are found and their offsets allowed for.
    scene : rigs.scene.Scene, optional
        Windows, tubes and hardware between cameras and target, in the rig's world and unit. Which
        camera looks through which solid is found by tracing. The rig's cameras look through it.
    windows : sequence of WindowPrior
        Windows whose pose and thickness are adjusted too, with standard deviations of those given.
    progress : callable, optional
        Called with a line of text at each step.

    Raises
    ------
    ValueError
        In one line, if cameras share no views (they are named), a camera has too few, the target
        is ambiguous, or names do not match.
    """
    report = progress or (lambda _: None)
    _check(observations, intrinsics)
    check_options(
        observations.cameras,
        observations.frames,
        intrinsics=intrinsics,
        world=world,
        rescale=rescale,
        length_unit=length_unit,
        distortion=distortion,
        target=target,
        scene=scene,
    )
    intrinsics = intrinsics and _lenses(intrinsics, length_unit)
    names, points = observations.cameras, observations.target_points
    rules = LensRules(square_pixels, fixed_center, common_lenses(names, common_lens))
    known = {"square_pixels": square_pixels, "fixed_center": fixed_center}
    check_lens_options(intrinsics, known | {"common_lens": rules.common})
    check_common_sizes(rules.common, observations.image_sizes, names)
    keep, frozen, repeats = without_repeats(observations)
    scale = float(np.linalg.norm(np.ptp(points, axis=0)))  # adjusted in units of the target's size
    together = partial(
        adjust_together,
        scale=scale,
        distortion=distortion,
        rules=rules,
        cull=cull,
        times=times,
        report=report,
    )
    if scene is None:
        adjusted = together(observations, np.flatnonzero(keep), intrinsics=intrinsics)
    else:
        through = _through(scene, windows, observations, world, scale)
        adjusted = adjust_through(
            through, together, observations, np.flatnonzero(keep), intrinsics, cull, report
        )
    found, world_frame, size, poorly_met = in_world(
        adjusted.scene.scaled(scale), names, observations.frames, world, rescale
    )
    if size != 1:
        observations = replace(observations, target_points=points * size)
    arrays, used = adjusted.arrays.scaled(scale * size), np.zeros(len(observations), bool)
    rig = Rig(_cameras(observations, found, intrinsics), length_unit, world_frame, volume)
    if scene is not None and found.refraction is not None:
        adjusted_solids = {name: found.refraction.window(name) for name in found.windows}
        solids = tuple(adjusted_solids.get(solid.name, solid) for solid in scene.solids)
        optical = replace(scene, solids=solids)
        check_scene(optical, rig)
        rig = rig.through(optical)
    report("quality")
    quality, noise, covariance = measure(
        rig, found, arrays, adjusted.used, adjusted.freedom, volume
    )
    quality = adjusted.by_number(quality)
    stated = zip(rig, quality.accuracy, strict=True)
    rig = replace(rig, cameras=tuple(camera.with_accuracy(own) for camera, own in stated))
    refuse_unknown_lenses(quality.focal_error, names)
    residuals = np.full((len(observations), 2), np.nan)
    residuals[adjusted.rows] = arrays.uv - predicted(found, arrays)
    used[adjusted.rows] = adjusted.used
    voxel = None if volume is None else float(np.prod(volume.spacing)) ** (1 / 3)
    synchrony = adjusted.synchrony
    offsets = None if synchrony is None else synchrony.in_words()
    held = rules.in_words()
    warnings, notes = findings(quality, observations, used, noise, voxel, offsets, held)
    seen_windows: tuple[AdjustedWindow, ...] = ()
    through_what: list[list[str]] = []
    if found.refraction is not None:
        seen_windows = adjusted_windows(found.refraction, adjusted.freedom, covariance)
        through_what = looked_through(adjusted, len(names))
        contradictions, of_scene = window_findings(
            found.refraction, seen_windows, through_what, length_unit
        )
        warnings, notes = (*contradictions, *warnings), (*notes, *of_scene)
    else:
        panes = ignored_glass(found, arrays.where(adjusted.used), adjusted.freedom)
        lines = (pane.in_words(names[pane.camera], length_unit) for pane in panes)
        warnings = (*lines, *warnings)
    warnings = (*frozen, *poorly_met, *warnings)
    unposed = _unposed(found, arrays, observations.frames)
    notes = (*adjusted.out_of_step(observations), *repeats, *unposed, *notes)
    calibration = Calibration(
        rig,
        observations,
        residuals,
        used,
        found.target_R,
        found.target_t,
        tuple(one.name for one in adjusted.terms),
        noise,
        labels(names, adjusted.freedom, found.windows),
        covariance,
        names[adjusted.root],
        quality,
        warnings + notes,
        assessment(quality, warnings, notes, length_unit, voxel),
        synchrony,
        seen_windows,
        tuple(map(tuple, through_what)),
    )
    return replace(calibration, rig=replace(rig, calibration=summary(calibration)))


def _through(
    scene: OpticalScene,
    windows: Sequence[WindowPrior],
    observations: Observations,
    world: str | Mapping[str, ArrayLike] | None,
    scale: float,
) -> Through:
    """Return the scene that the target is seen through, and the world that it stands in."""
    names, frames = observations.cameras, observations.frames
    of_camera = names[0] if world is None else world
    held = names.index(of_camera) if isinstance(of_camera, str) and of_camera in names else None

    def placed(unknowns: Scene) -> Scene:
        return in_world(unknowns.scaled(scale), names, frames, world, False)[0].scaled(1 / scale)

    return Through(scene, windows, placed, scale, held)


def _unposed(scene: Scene, arrays: ObservationArrays, frames: tuple[str, ...]) -> tuple[str, ...]:
    """Return a line on the frames that show too little of the target for its pose."""
    shown = np.unique(arrays.frame)
    names = [frames[frame] for frame in shown if np.isnan(scene.target_t[frame, 0])]
    if not names:
        return ()
    return (
        f"frames {some(names)}: no camera saw 6 points of the target that are not "
        "on a line, not used",
    )


def _cameras(
    observations: Observations, scene: Scene, intrinsics: Rig | None
) -> tuple[Camera, ...]:
    """Return the scene's cameras as values of the package."""
    return tuple(
        Camera(
            name,
            observations.image_sizes[index],
            scene.lenses[index].matrix,
            scene.lenses[index].distortion,
            scene.camera_R[index],
            scene.camera_t[index],
            None if intrinsics is None else intrinsics[name].optics,
            "calibrated",
        )
        for index, name in enumerate(observations.cameras)
    )


def _lenses(intrinsics: Rig, length_unit: str) -> Rig:
    """Return the cameras themselves of a rig of known lenses, their figures in a unit."""
    own = replace(intrinsics, cameras=tuple(map(own_camera, intrinsics)))
    return in_unit(own, length_unit) if any(camera.optics for camera in own) else own


def _check(observations: Observations, intrinsics: Rig | None) -> None:
    """Raise unless there are observations of a flat target, in images of the given sizes."""
    names = observations.cameras
    if not names or not len(observations):
        raise ValueError("observations: found none, expected the target in some images")
    if np.ptp(observations.target_points[:, 2]) > 0:
        raise ValueError("target_points: found points off the plane z = 0, expected a flat target")
    for name, size in zip(names, observations.image_sizes, strict=True):
        if intrinsics is not None and name in intrinsics and intrinsics[name].image_size != size:
            raise ValueError(
                f"intrinsics: camera {name}: image_size: found {intrinsics[name].image_size}, "
                f"expected {size} as its images"
            )
