"""Bad pixels and wrong views are left out and named; right images are not."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from rigs import Rig
from studies.common.study import Request
from studies.stress import robustness_scene as scenes
from studies.stress.robustness_scene import ALIKE, FLAMES, OTHER, WRONG, Images, Scene, scene
from studies.stress.row import Row, worst_of
from tomo import Scan
from tomo.inference.finding import LEFT_OUT
from tomo.measurement.pixel_check import check_pixels
from tomo.pipeline import Options, Reconstruction, reconstruct
from tomo.simulation.effects import Effects

WORSE = 1.5  # how many times its clean error the default method may have
BAD_PIXELS = 0.01
FALSE_ALARMS = 1e-4
SHRINK = {True: 0.3, False: 2 / 3}

IN_QUICK = {
    "jet": ("one", "another flame", "another camera's image"),
    "turbulent": ("1 %", "another moment", "mirrored", "both"),
}
"""What goes wrong with each flame of the small version."""

RIGHT: dict[str, Effects | None] = {
    "as they are": None,
    "gains 10 %": Effects(gain_spread=0.1),
    "absorption": Effects(absorption=0.03),
    "vignetting 40 %": Effects(vignetting=0.4),
    "defocus": Effects(aperture=150.0, focus_distance=5750.0),
}
RIGHT_IN_QUICK = ("as they are", "gains 10 %", "vignetting 40 %")


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    quick = request.size != "full"
    shrink = SHRINK[quick]
    seeds = [request.seed + 1] if quick else [request.seed + 1, request.seed + 2, request.seed + 3]
    cases = [(flame, seed) for flame in FLAMES for seed in seeds]
    setting = f"33 views at {shrink:.2g} of the preset's size, "
    setting += f"{len(seeds)} seed{'s' if len(seeds) > 1 else ''}"
    found = []
    for flame, seed in request.each(cases, "{0[0]}, seed {0[1]}".format):
        some = IN_QUICK[flame] if quick else ()
        found.append(_Measured.of(scene(flame, seed, shrink), seed, shrink, some))

    ways = dict.fromkeys(
        where.partition(", ")[2] for one in found for where, _ in one.errors["view"]
    )

    def over(kind: str) -> str:
        whose = {one.scene.flame for one in found if one.errors[kind]}
        who = "both flames" if len(whose) > 1 else f"a {whose.pop()} flame"
        return f"{who}, {setting}" + (f"; {', '.join(ways)}" if kind == "view" else "")

    def row(stress: str, kind: str) -> Row:
        figure, where = worst_of(pair for one in found for pair in one.errors[kind])
        cosine = max(one.cosines[kind] for one in found)
        note = f"worst: {where}; cosine distance {cosine:.2f} times its clean one at most"
        return Row(
            f"{stress}: NRMSE over the clean one", over(kind), figure, WORSE, "times", note=note
        )

    def faults(stress: str, kind: str, but: str = "") -> Row:
        missing = [fault for one in found for fault in one.faults[kind]]
        return Row.of_faults(stress, over(kind), missing, but)

    yield row("1 % bad pixels", "bad pixels")
    yield faults("1 % bad pixels: no warning", "bad pixels")
    yield row("one pixel a thousand times too bright", "pixel")
    yield row("one wrong view", "view")
    yield faults(
        "one wrong view: not named, or a right one named",
        "view",
        f"a jet looks nearly the same from all sides: {', '.join(ALIKE)} need no name",
    )
    yield row("two swapped views", "swap")
    yield faults(
        "two swapped views: not both named, or others",
        "swap",
        but="those of a jet, which are alike, must not be named",
    )
    # The turbulent flame has the finer detail, which alarms are to be feared of.
    if quick:
        yield from _right(request, shrink, cases[-1:], RIGHT_IN_QUICK)
    else:
        yield from _right(request, shrink, cases[:: len(seeds)], tuple(RIGHT))


class _Measured:
    """Errors and faults of one flame."""

    def __init__(self, one: Scene) -> None:
        self.scene = one
        self.clean = one.reconstructed(one.images).solution.quality
        self.errors: dict[str, list[tuple[str, float]]] = defaultdict(list)
        self.cosines: dict[str, float] = defaultdict(float)
        self.faults: dict[str, list[str]] = defaultdict(list)

    @classmethod
    def of(cls, one: Scene, seed: int, shrink: float, some: Collection[str] = ()) -> _Measured:
        """Let everything go wrong, or ``some`` of it."""
        names = one.rig.names
        measured = cls(one)
        if not some or "1 %" in some:
            images = scenes.with_bad_pixels(one.images, BAD_PIXELS, seed)
            measured.add("bad pixels", "1 %", images, bad_pixels=True)
        if not some or "one" in some:
            measured.add("pixel", "one", scenes.one_bad_pixel(one.images))
        for what, images, visible in scenes.wrong_views(one, seed, shrink):
            if not some or what in some:
                measured.add("view", what, images, names[WRONG : WRONG + 1] if visible else None)
        if not some or "both" in some:
            both = (names[WRONG], names[OTHER]) if one.flame != "jet" else None
            measured.add("swap", "both", scenes.swapped(one.images), both)
        return measured

    def add(
        self,
        kind: str,
        what: str,
        images: Images,
        wrong: tuple[str, ...] | None = (),
        bad_pixels: bool = False,
    ) -> None:
        """Reconstruct; ``wrong`` are the views to be named, None where none has to be."""
        outcome = self.scene.reconstructed(images)
        quality, where = outcome.solution.quality, f"{self.scene.flame}, {what}"
        times = quality["nrmse"] / self.clean["nrmse"]
        cosine = quality["cosine_distance"] / self.clean["cosine_distance"]
        self.errors[kind].append((where, times))
        self.cosines[kind] = max(self.cosines[kind], cosine)
        faults = self.faults[kind]
        if bad_pixels and not any(one.effect == "bad pixels" for one in outcome.findings):
            faults.append(f"{where}: no warning")
        if wrong is not None:
            faults += [f"{where}: {fault}" for fault in _not_as_named(outcome, wrong)]


def _not_as_named(outcome: Reconstruction, wrong: tuple[str, ...]) -> Iterator[str]:
    found = {one.camera for one in outcome.findings if one.camera and one.effect != "bad pixels"}
    for name in wrong:
        if name not in found:
            yield f"{name} not named"
    for name in sorted(found):
        if name not in wrong:
            yield f"{name} named"


def _right(
    request: Request, shrink: float, cases: list[tuple[str, int]], whats: tuple[str, ...]
) -> Iterator[Row]:
    """Judge images with nothing wrong about them but what every camera has."""
    alarms, bad_ones, pixels, judged = [], 0, 0, 0
    both = product(cases, whats)
    for (flame, seed), what in request.each(both, "{0[0][0]}, {0[1]}".format):
        one = scene(flame, seed, shrink, RIGHT[what])
        for name, rig, images in _variants(one, what, seed):
            masks = [np.ones(image.shape, bool) for image in images]
            found = check_pixels(rig.names, images, masks)
            alarms += [f"{flame}, {name}: {out}" for out in _left_out(one, rig, images)]
            bad_ones += sum(found.outliers.values())
            pixels += sum(found.usable.values())
            judged += 1
    over = f"{judged} sets: " + ", ".join([*whats, "noise", "3 px off", "5 and 11 views"])
    yield Row.of_faults("right images: views left out", over, alarms)
    yield Row("right images: pixels left out", over, bad_ones / pixels, FALSE_ALARMS, "of all")


def _left_out(one: Scene, rig: Rig, images: Images) -> list[str]:
    """Return the cameras that are left out, wholly or in part, though nothing is wrong."""
    scan = Scan.from_arrays(rig, dict(zip(rig.names, images, strict=True)), one.grid)
    outcome = reconstruct(scan, options=Options(method="mlem", iterations=1, uncertainty=0))
    return [str(each.camera) for each in outcome.findings if each.effect in LEFT_OUT]


def _variants(one: Scene, what: str, seed: int) -> Iterator[tuple[str, Rig, Images]]:
    yield what, one.rig, one.images
    if what != "as they are":
        return
    random = np.random.default_rng(seed)
    noise = 0.1 * one.brightest
    noisy = [
        (image + noise * random.standard_normal(image.shape)).astype(np.float32)
        for image in one.images
    ]
    yield "noise 10 %", one.rig, noisy
    shrunk = 3.0 * one.rig[0].image_size[0] / 90  # of the preset's own pixels
    yield "3 px off", scenes.shifted(one.rig, shrunk, seed), one.images
    for count in (5, 11):
        kept = range(0, 33, 33 // count)[:count]
        cameras = tuple(one.rig[view] for view in kept)
        yield f"{count} views", replace(one.rig, cameras=cameras), [one.images[v] for v in kept]
