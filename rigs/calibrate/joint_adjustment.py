"""One adjustment of everything: from observations to lenses, poses and moments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.culling import Culled, adjust_and_cull
from rigs.calibrate.adjust.film import Film
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.initial import (
    SingleCamera,
    check_target_poses,
    lens_alone,
    single_camera,
)
from rigs.calibrate.adjust.lens_choice import LensRules, Terms, richer_terms
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, ordered
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.adjust.shared_views import rig_poses
from rigs.calibrate.observations import Observations
from rigs.calibrate.quality.quality import Quality
from rigs.calibrate.synchrony import Synchrony, adjust_in_step, in_step
from rigs.camera_protocol import CameraLike, has_lens
from rigs.rig import Rig

_GIVEN = Terms("given", "none", ())


@dataclass(frozen=True, eq=False)
class Adjusted:
    """An adjusted scene with the observations that it explains."""

    scene: Scene
    arrays: ObservationArrays  # points where the target was when the image was taken
    rows: NDArray[np.int64]  # (N,) places among the observations given
    used: NDArray[np.bool_]  # (N,)
    freedom: Freedom
    terms: list[Terms]  # each camera's
    root: int  # the camera whose pose is held
    film: Film | None
    synchrony: Synchrony | None

    def by_number(self, quality: Quality) -> Quality:
        """Return the figures with those of images under the frames of their own numbers."""
        if self.film is None or self.synchrony is None:
            return quality
        filed = np.stack([self.film.partners(-delay) for delay in self.synchrony.whole])

        def own(figures: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.where(filed >= 0, np.take_along_axis(figures, filed, 1), np.nan)

        return replace(
            quality,
            image_rms=own(quality.image_rms),
            alone_rms=own(quality.alone_rms),
            contradiction=own(quality.contradiction),
        )

    def out_of_step(self, observations: Observations) -> tuple[str, ...]:
        """Return lines on cameras out of step, and on images of moments that nothing shows."""
        if self.synchrony is None:
            return ()
        placed = np.zeros(len(observations), bool)
        placed[self.rows] = np.isfinite(self.arrays.points[:, 0])
        lines = list(self.synchrony.findings(observations.cameras))
        for camera in np.flatnonzero(self.synchrony.is_out):
            own = observations.camera == camera
            count = len(np.setdiff1d(observations.frame[own], observations.frame[own & placed]))
            if count:
                lines.append(
                    f"camera {observations.cameras[camera]}: {count} of its images were taken "
                    "where the films have a gap or an end, which leaves the target's place then "
                    "unknown: not used"
                )
        return tuple(lines)


def adjust_together(
    observations: Observations,
    kept: NDArray[np.int64],
    scale: float,
    *,
    intrinsics: Rig | None,
    distortion: str,
    rules: LensRules,
    cull: bool,
    times: Mapping[str, float] | None,
    report: Callable[[str], None],
) -> Adjusted:
    """Return the joint adjustment of the ``kept`` rows of observations.

    Options are those of `rigs.calibrate.calibrate`; lengths are divided by ``scale``.
    """
    names = observations.cameras
    order = ordered(observations)
    order = order[np.isin(order, kept)]
    arrays = ObservationArrays(
        observations.camera[order],
        observations.frame[order],
        observations.target_points[observations.point[order]] / scale,
        observations.uv[order],
    )
    views = _single_cameras(observations, arrays, intrinsics, distortion, rules, report)
    report("poses along shared views")
    film = None
    if times is not None and len(names) > 1:
        film = Film.of(np.array([times.get(name, np.nan) for name in observations.frames]), arrays)
    scene, root, whole = rig_poses(names, views, arrays, len(observations.frames), film)
    freedom = Freedom(
        tuple(
            np.zeros(view.lens.size, bool) if view.terms is _GIVEN else view.terms.freedom(rules)
            for view in views
        ),
        np.arange(len(views)) != root,
        square=rules.square_pixels,
        common=rules.common,
    )
    synchrony, fraction = None, np.zeros(len(views))
    if film is not None:
        report("moments of the images")
        rows, filed = film.filed(arrays, whole)
        synchrony = in_step(film, scene, arrays, filed, freedom, whole)
        order, arrays, fraction = order[rows], filed, synchrony.fraction
        if synchrony.is_out.any():
            freedom = replace(freedom, time=synchrony.is_out)
    report("joint adjustment")
    found, arrays, freedom, terms, fraction = _adjusted(
        scene, arrays, views, freedom, distortion, rules, cull, film, fraction
    )
    if synchrony is not None:
        synchrony = synchrony.with_fraction(fraction)
    return Adjusted(
        found.solution.scene, arrays, order, found.used, freedom, terms, root, film, synchrony
    )


def _single_cameras(
    observations: Observations,
    arrays: ObservationArrays,
    intrinsics: Rig | None,
    distortion: str,
    rules: LensRules,
    report: Callable[[str], None],
) -> list[SingleCamera]:
    """Return each camera's lens, found from its own images or given, and its target poses."""
    frames = len(observations.frames)
    first = range(len(observations.cameras)) if rules.common is None else rules.common
    lenses: dict[int, tuple[Lens, Terms]] = {}
    views = []
    for camera, name in enumerate(observations.cameras):
        report(f"lens of camera {name}")
        own = arrays.where(arrays.camera == camera)
        own = replace(own, camera=np.zeros(len(own), np.int64))
        if intrinsics is not None:
            lenses[camera] = _given(intrinsics[name])
        elif first[camera] == camera:
            # Images of all cameras with this lens, as if one camera had taken them
            one = arrays.where(np.isin(arrays.camera, np.flatnonzero(np.equal(first, camera))))
            moments = one.frame + frames * one.camera
            one = replace(one, camera=np.zeros(len(one), np.int64), frame=moments)
            lenses[camera] = lens_alone(
                name,
                one,
                frames * len(observations.cameras),
                observations.image_sizes[camera],
                distortion,
                rules,
            )
        views.append(single_camera(*lenses[first[camera]], own, frames))
        check_target_poses(name, views[-1])
    return views


def _adjusted(
    scene: Scene,
    arrays: ObservationArrays,
    views: list[SingleCamera],
    freedom: Freedom,
    distortion: str,
    rules: LensRules,
    cull: bool,
    film: Film | None,
    offset: NDArray[np.float64],
) -> tuple[Culled, ObservationArrays, Freedom, list[Terms], NDArray[np.float64]]:
    """Return the joint adjustment, its observations, what was free, lens terms and offsets.

    ``auto`` frees terms that pay only jointly. Out of step the moment of images is free.
    """
    unmoved, terms = arrays, [view.terms for view in views]

    def adjusted(scene: Scene, freedom: Freedom) -> Culled:
        nonlocal arrays, offset
        if film is None or (freedom.time is None and not offset.any()):
            return adjust_and_cull(scene, arrays, freedom, cull)
        kept, arrays, offset = adjust_in_step(film, scene, unmoved, freedom, cull, offset)
        return kept

    kept = adjusted(scene, freedom)
    if distortion == "auto":
        richer = richer_terms(kept.solution.scene, arrays.where(kept.used), freedom, terms, rules)
        if richer is not None:
            scene, freedom, terms = richer
            kept = adjusted(scene, freedom)
    return kept, arrays, freedom, terms, offset


def _given(camera: CameraLike) -> tuple[Lens, Terms]:
    """Return the lens of a camera whose intrinsics are kept."""
    assert has_lens(camera)  # `check_options` let no other pass
    lens = camera.distortion
    return Lens(camera.camera_matrix, lens.model, np.array(lens.coefficients)), _GIVEN
