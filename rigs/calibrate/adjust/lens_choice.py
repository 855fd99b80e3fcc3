"""The terms of a lens model: by cross-validation over frames, then by the joint adjustment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import Solution, fall_of_squares, information
from rigs.calibrate.adjust.culling import adjust_robustly, noise
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, jacobian, predicted
from rigs.calibrate.adjust.projection import Lens

# Standard errors by which the gain must exceed zero. A needless term of the polynomials costs
# less than a missing one; the rational model's poles make it demand more.
_STANDARD_ERRORS = {"none": 0.0, "radial": 0.0, "brown4": 0.0, "brown5": 0.0, "rational": 2.0}


@dataclass(frozen=True)
class LensRules:
    """What is known of lenses beforehand."""

    square_pixels: bool = False  # fx and fy are equal
    fixed_center: bool = False  # the principal point is in the middle of the image
    common: tuple[int, ...] | None = (
        None  # for each camera the first one of its lens; None: its own
    )

    def in_words(self) -> str:
        """Return the lens that is held, in words; a given one where nothing else is known."""
        known = {
            "square pixels": self.square_pixels,
            "a fixed centre": self.fixed_center,
            "a common lens": self.common is not None,
        }
        words = " and ".join(word for word, is_so in known.items() if is_so)
        return f"lens with {words}" if words else "given lens"

    def one_lens(self, free: NDArray[np.bool_]) -> Freedom:
        """Return the freedom of one camera at rest whose lens has these free numbers."""
        return Freedom((free,), np.zeros(1, bool), square=self.square_pixels)


@dataclass(frozen=True)
class Terms:
    """A lens model of `rigs.Distortion` and which of its coefficients are free."""

    name: str
    model: str
    free: tuple[bool, ...]  # one for each coefficient; those not free stay zero

    def freedom(self, rules: LensRules) -> NDArray[np.bool_]:
        """Return which of fx, fy, cx, cy and the coefficients are free, ``(4 + n,)``."""
        centre = not rules.fixed_center
        return np.r_[True, True, centre, centre, np.array(self.free, bool)]


#: The models of `calibrate`; each contains those before it, except the fisheye.
TERMS: dict[str, Terms] = {
    terms.name: terms
    for terms in (
        Terms("none", "none", ()),
        Terms("radial", "brown", (True, True, False, False)),
        Terms("brown4", "brown", (True,) * 4),
        Terms("brown5", "brown", (True,) * 5),
        Terms("rational", "rational", (True,) * 8),
        Terms("thin_prism", "thin_prism", (True,) * 12),
        Terms("tilted", "tilted", (True,) * 14),
        Terms("fisheye", "fisheye", (True,) * 4),
    )
}
_LADDER = ("none", "radial", "brown4", "brown5")  # terms that only the joint adjustment may free
_DETERMINED = 1e-8  # relative least eigenvalue of a lens's normal equations; below it is noise


def choose(
    start: Scene,
    observations: ObservationArrays,
    image_size: tuple[int, int],
    requested: str,
    rules: LensRules,
) -> tuple[Terms, Solution]:
    """Return the terms of one camera's lens that lower the error of held-out frames.

    ``requested`` names the terms, or is "auto". Each frame's cost is predicted with the lens
    adjusted to all the other frames, to second order; a richer model must lower the mean. A model
    that maps no direction to a corner of the image is not taken. The rational model is tried only
    where all of brown5 was taken.
    """
    if requested != "auto":
        freedom = rules.one_lens(TERMS[requested].freedom(rules))
        return TERMS[requested], _fit(start, observations, TERMS[requested], freedom)
    best: tuple[Terms, Solution] | None = None
    best_score = np.zeros(0)
    for name, standard_errors in _STANDARD_ERRORS.items():
        terms = TERMS[name]
        if name == "rational" and (best is None or best[0].name != "brown5"):
            break
        freedom = rules.one_lens(terms.freedom(rules))
        if 2 * len(observations) <= 6 * len(np.unique(observations.frame)) + freedom.size:
            break
        solution = _fit(start if best is None else best[1].scene, observations, terms, freedom)
        score = held_out_costs(solution, observations, freedom)
        if best is None:
            best, best_score = (terms, solution), score
            continue
        if not np.isfinite(score).all():
            continue
        if not np.isfinite(best_score).all():
            best, best_score = (terms, solution), score
            continue
        gain = best_score - score
        error = gain.std(ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.inf
        is_better = gain.mean() > standard_errors * error
        if is_better and covers_image(solution.scene.lenses[0], image_size):
            best, best_score = (terms, solution), score
    assert best is not None  # `lens_alone` has images enough for a lens without terms
    return best


def covers_image(lens: Lens, image_size: tuple[int, int]) -> bool:
    """Return whether every pixel at the image's edge has a line of sight."""
    width, height = image_size
    u, v = np.linspace(-0.5, width - 0.5, 17), np.linspace(-0.5, height - 0.5, 17)
    edge = np.concatenate(
        [np.stack([u, np.full(17, side)], -1) for side in (-0.5, height - 0.5)]
        + [np.stack([np.full(17, side), v], -1) for side in (-0.5, width - 0.5)]
    )
    plane = np.linalg.solve(lens.matrix, np.c_[edge, np.ones(len(edge))].T).T[:, :2]
    return bool(np.isfinite(lens.distortion.unproject(plane)).all())


def held_out_costs(
    solution: Solution, observations: ObservationArrays, freedom: Freedom
) -> NDArray[np.float64]:
    """Return each frame's cost with the lens adjusted to all other frames, ``(frames,)``.

    With S_f and g_f the normal equations and gradient that frame f gives the lens, its own pose
    eliminated, leaving it out moves the lens by ``d = -(S - S_f)^-1 g_f``, where the gradient of
    all is zero; its cost then is ``cost_f - g_f d + d S_f d / 2``. Infinite where the terms are
    not determined, or the adjustment has not converged.
    """
    uv, by_camera, by_target = jacobian(
        solution.scene, observations, 0, slice(0, len(observations))
    )
    _, by_camera = freedom.gathered(0, by_camera)
    residual = observations.uv - uv
    huber = 3 * noise(residual, observations.camera, 1)[0]
    length = np.maximum(np.linalg.norm(residual, axis=1), 1e-300)
    weight = np.sqrt(np.minimum(1.0, huber / length))[:, None]
    costs, by_lens, falls = [], [], []
    for frame in np.unique(observations.frame):
        own = observations.frame == frame
        A = (by_camera[own] * weight[own, :, None]).reshape(-1, freedom.size)
        B = (by_target[own] * weight[own, :, None]).reshape(-1, 6)
        r = (residual[own] * weight[own]).reshape(-1)
        pose, *_ = np.linalg.lstsq(B, np.c_[A, r], rcond=None)
        left = A - B @ pose[:, :-1]
        costs.append(
            np.where(
                length[own] > huber, huber * (2 * length[own] - huber), length[own] ** 2
            ).sum()
            / 2
        )
        by_lens.append(left.T @ left)
        falls.append(left.T @ (r - B @ pose[:, -1]))
    matrices, gradients = np.array(by_lens), np.array(falls)
    scale = np.sqrt(np.maximum(np.einsum("fii->i", matrices), 1e-300))
    matrices, gradients = matrices / np.outer(scale, scale), gradients / scale
    whole = matrices.sum(axis=0)
    values = np.linalg.eigvalsh(whole)
    slack = float(gradients.sum(axis=0) @ np.linalg.pinv(whole) @ gradients.sum(axis=0))
    if values[0] < _DETERMINED * values[-1] or slack > 1e-3 * sum(costs):
        return np.full(len(costs), np.inf)
    rest = whole - matrices + 1e-12 * np.eye(len(scale))
    shift = -np.linalg.solve(rest, gradients[:, :, None])[:, :, 0]  # (frames, n)
    return (
        np.array(costs)
        - np.einsum("fi,fi->f", gradients, shift)
        + np.einsum("fi,fij,fj->f", shift, matrices, shift) / 2
    )


def _fit(
    start: Scene, observations: ObservationArrays, terms: Terms, freedom: Freedom
) -> Solution:
    """Return the one-camera scene adjusted with ``terms`` free."""
    lens = start.lenses[0].with_model(terms.model, len(terms.free))
    scene = Scene((lens,), start.camera_R, start.camera_t, start.target_R, start.target_t)
    return adjust_robustly(scene, observations, freedom)


def richer_terms(
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    terms: list[Terms],
    rules: LensRules,
) -> tuple[Scene, Freedom, list[Terms]] | None:
    """Return the scene with more terms, up to brown5, where the joint adjustment supports them.

    One camera's images cannot always separate its lens from the target's pose. The term is taken
    whose predicted fall of squares (Rao's score test, without outliers) most exceeds twice the
    noise's variance (Akaike's criterion); None where none does.
    """
    may_grow = [one.name in _LADDER[:-1] for one in terms]
    if not any(may_grow):
        return None
    wide = replace(
        scene,
        lenses=tuple(
            lens.with_model("brown", 5) if grows else lens
            for lens, grows in zip(scene.lenses, may_grow, strict=True)
        ),
    )
    full = [
        TERMS["brown5"].freedom(rules) if grows else np.ones(lens.size, bool)
        for lens, grows in zip(wide.lenses, may_grow, strict=True)
    ]
    every = replace(freedom, lens=tuple(full))
    matrix, gradient = information(wide, observations, every)
    free = every.freed_in(freedom)
    residuals = observations.uv - predicted(scene, observations)
    unknowns = int(free.sum()) + 6 * len(np.unique(observations.frame))
    variance = float((residuals**2).sum()) / max(residuals.size - unknowns, 1)
    base = fall_of_squares(matrix, gradient, free)
    chosen = list(terms)
    first = range(len(terms)) if rules.common is None else rules.common
    for camera in (camera for camera in np.flatnonzero(may_grow) if first[camera] == camera):
        best = 0.0
        for name in _LADDER[_LADDER.index(terms[camera].name) + 1 :]:
            lens = TERMS[name].freedom(rules)
            tried = (lens if first[k] == camera else own for k, own in enumerate(freedom.lens))
            freed = free | every.freed_in(replace(freedom, lens=tuple(tried)))
            count = int((freed & ~free).sum())
            gain = fall_of_squares(matrix, gradient, freed) - base - 2 * count * variance
            if gain > best:
                best, chosen[camera] = gain, TERMS[name]
    chosen = [chosen[camera] for camera in first]
    if chosen == terms:
        return None
    lenses, lens_freedom = list(scene.lenses), list(freedom.lens)
    for place, (one, before) in enumerate(zip(chosen, terms, strict=True)):
        if one != before:
            lenses[place] = lenses[place].with_model(one.model, len(one.free))
            lens_freedom[place] = one.freedom(rules)
    return (
        replace(scene, lenses=tuple(lenses)),
        replace(freedom, lens=tuple(lens_freedom)),
        chosen,
    )
