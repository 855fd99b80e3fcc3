"""What may be wrong with a set of images, each in three sizes, made from faultless exposures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigs import Camera
from rigs.geometry.rotation import matrix_of_vector
from studies.scenes import cameras
from studies.scenes.exposure import Exposure
from studies.scenes.fields import LaterField, WithLamp
from studies.scenes.media import Gas, cloud, hot_core, sheath

Exposures = tuple[Exposure, ...]


@dataclass(frozen=True)
class Setting:
    """Where a fault goes."""

    view: int  # the camera at fault, for faults of one camera
    size: float  # how large the fault is, in its own unit
    brightest: float  # the brightest pixel of the faultless images, in the field's unit
    random: np.random.Generator


@dataclass(frozen=True)
class Fault:
    """One kind of fault."""

    # the effects by which a report may call it, keys of `studies.scenes.findings.EFFECTS`; those
    # of the camera at fault first, of other cameras last
    names: tuple[tuple[str, ...], ...]
    # from the faultless exposures and a `Setting` to the faulty ones
    make: Callable[[Exposures, Setting], Exposures]
    # settle, report: the three sizes of either half, in the unit that ``make`` says
    settle: tuple[float, float, float]
    report: tuple[float, float, float]
    single: bool = True  # whether it is of one camera, or of two, which a report should name
    # how many of its sizes, from the smallest, a correction may mend. Where none can, it is enough
    # to name the fault and not to trust the volume
    mendable: int = 3


def _one(exposures: Exposures, view: int, **changes: Any) -> Exposures:
    """Return exposures of which one is changed."""
    found = list(exposures)
    found[view] = replace(found[view], **changes)
    return tuple(found)


def _all(exposures: Exposures, **changes: Any) -> Exposures:
    """Return exposures that are all changed alike."""
    return tuple(replace(one, **changes) for one in exposures)


def _through(exposures: Exposures, **gas: Any) -> Exposures:
    """Return exposures through the same gas."""
    return _all(exposures, gas=Gas(**gas))


def _moved(
    move: Callable[[Exposure, Setting], Camera],
) -> Callable[[Exposures, Setting], Exposures]:
    """Return the fault of a camera that really stands, or looks, as ``move`` says."""

    def make(exposures: Exposures, setting: Setting) -> Exposures:
        camera = move(exposures[setting.view], setting)
        return _one(exposures, setting.view, camera=camera)

    return make


def _set(name: str) -> Callable[[Exposures, Setting], Exposures]:
    """Return the fault of one camera whose exposure has ``name`` at the fault's size."""
    return lambda exposures, setting: _one(exposures, setting.view, **{name: setting.size})


def _set_all(name: str) -> Callable[[Exposures, Setting], Exposures]:
    """Return the fault of all cameras whose exposures have ``name`` at the fault's size."""
    return lambda exposures, setting: _all(exposures, **{name: setting.size})


def shifted(one: Exposure, setting: Setting) -> Camera:
    """Return a camera whose image lies ``size`` pixels off, in a random direction."""
    angle = setting.random.uniform(0, 2 * np.pi)
    return one.camera.shifted(setting.size * np.cos(angle), setting.size * np.sin(angle))


def magnified(one: Exposure, setting: Setting) -> Camera:
    """Return a camera whose focal length is larger by the fraction ``size``."""
    return cameras.magnified(one.camera, 1 + setting.size)


def rolled(one: Exposure, setting: Setting) -> Camera:
    """Return a camera turned about its line of sight by ``size`` degrees."""
    roll = matrix_of_vector(np.deg2rad(setting.size) * np.array([0, 0, 1.0]))
    return replace(one.camera, R=roll @ one.camera.R, t=roll @ one.camera.t)


def walked(one: Exposure, setting: Setting) -> Camera:
    """Return a camera that went ``size`` degrees around the grid and still looks at its middle."""
    middle = np.asarray(one.field.grid.center)
    turn = matrix_of_vector(np.deg2rad(setting.size) * np.array([0, 1.0, 0]))
    return one.camera.transformed(turn, middle - turn @ middle)


def swapped(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which two have each other's image, ``size`` rigs apart."""
    first, number = exposures[setting.view].camera, _other(exposures, setting)
    other = exposures[number].camera
    return _one(_one(exposures, setting.view, camera=other), number, camera=first)


def doubled(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one has the file of another, a fraction ``size`` apart."""
    number = _other(exposures, setting)
    return _one(exposures, setting.view, camera=exposures[number].camera, taken_by=number)


def _other(exposures: Exposures, setting: Setting) -> int:
    """Return the number of the camera a fraction of the rig away whose images have one's size."""
    views, size = len(exposures), exposures[setting.view].camera.image_size
    apart = max(round(setting.size * views), 1)
    order = [(setting.view + apart + step) % views for step in range(views)]
    alike = [v for v in order if v != setting.view and exposures[v].camera.image_size == size]
    if not alike:
        raise ValueError("fault: found no two cameras of one image size, expected two")
    return alike[0]


def all_magnified(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures whose focal lengths are all larger by the fraction ``size``."""
    return tuple(replace(one, camera=magnified(one, setting)) for one in exposures)


def framed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which two, a third of the rig apart, look past an opaque frame."""
    other = (setting.view + max(len(exposures) // 3, 1)) % len(exposures)
    return _one(_one(exposures, setting.view, framed=setting.size), other, framed=setting.size)


def hot_column(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one has a column near its middle that is ``size`` brighter."""
    width = exposures[setting.view].camera.image_size[0]
    column = round(width * setting.random.uniform(0.35, 0.65))
    return _one(exposures, setting.view, hot=(column, setting.size))


def smeared(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one moved by ``size`` pixels."""
    return _one(exposures, setting.view, motion=int(setting.size))


def capped(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one is noise alone (1), zeros (2) or the pedestal (3)."""
    dead = ("", "zeros", "pedestal")[int(setting.size) - 1]
    return _one(exposures, setting.view, gain=0.0, dead=dead)


def two_at_once(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of a camera's gain ``1 / (1 + size / 10)``, another ``size`` pixels off."""
    other = (setting.view + len(exposures) // 2) % len(exposures)
    found = _one(exposures, other, camera=shifted(exposures[other], setting))
    return _one(found, setting.view, gain=1 / (1 + setting.size / 10))


def clouded(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures past a cloud beside the flame, of the optical depth ``size``."""
    angle = setting.random.uniform(0, 2 * np.pi)
    return _through(exposures, absorber=cloud(exposures[0].field.grid, setting.size, angle))


def sheathed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures through a sheath around the flame, of the optical depth ``size``."""
    return _through(exposures, absorber=sheath(exposures[0].field.grid, setting.size))


def unequally_dimmed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures whose corners lose unlike fractions of the light, up to ``size``."""
    losses = setting.random.uniform(0, setting.size, len(exposures))
    return tuple(
        replace(one, vignetting=float(loss)) for one, loss in zip(exposures, losses, strict=True)
    )


def bent(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures through hot gas that displaces rays by up to ``size`` voxels."""
    return _through(exposures, bending=hot_core(exposures[0].field.grid, setting.size))


def mirrored(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one is turned over: across (1), down (2), or both (3)."""
    way = ("across", "down", "both")[int(setting.size) - 1]
    return _one(exposures, setting.view, mirrored=way)


def lit_by_lamp(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures that see a lamp outside of the grid; ``size`` is for brightest lines."""
    field = exposures[0].field
    across = np.sqrt(2 * np.pi) * 1.5 * field.grid.spacing[0]
    strength = setting.size * setting.brightest / across
    return _all(exposures, field=WithLamp(field, strength, setting.random.uniform(0, 2 * np.pi)))


def self_absorbed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of gas of the optical depth ``size`` along the brightest line of sight."""
    return _through(exposures, self_absorption=setting.size / setting.brightest)


def absorbed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures through a medium of the optical depth ``size`` across the grid."""
    return _through(exposures, absorption=setting.size / exposures[0].field.grid.extent[0])


def out_of_step(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one is of another moment: gas ``size`` voxels away."""
    field = exposures[setting.view].field
    later = LaterField(field.family, field.seed, field.grid, setting.size)
    return _one(exposures, setting.view, field=later)


POSE, LENS, GAS = ("pose",), ("magnification", "pose"), ("absorption",)
BACKGROUND, ORDER, APART = ("background",), ("order",), ("disagreement",)

FAULTS: Mapping[str, Fault] = {
    "gain": Fault((("gain",),), _set("gain"), (1.06, 0.85, 0.6), (0.93, 1.12, 0.65)),
    "background": Fault((BACKGROUND,), _set("background"), (0.01, 0.03, 0.1), (0.008, 0.04, 0.08)),
    "dark left in": Fault(
        ((*BACKGROUND, "dark"),),
        _set_all("background"),
        (0.005, 0.02, 0.06),
        (0.007, 0.017, 0.05),
        False,
    ),
    "shift": Fault((POSE,), _moved(shifted), (0.7, 1.4, 4.0), (0.8, 1.5, 3.5)),
    "roll": Fault((POSE,), _moved(rolled), (1.5, 4.0, 10.0), (2.0, 5.0, 9.0)),
    "pose": Fault((POSE,), _moved(walked), (1.5, 4.0, 10.0), (2.0, 5.0, 9.0)),
    "swapped": Fault((ORDER,), swapped, (0.08, 0.25, 0.4), (0.12, 0.2, 0.35)),
    "mirrored": Fault((("mirrored", "order"),), mirrored, (1, 2, 3), (1, 2, 3)),
    "hidden part": Fault(
        (("hidden",),), _set("hidden"), (0.08, 0.25, 0.5), (0.1, 0.2, 0.4), mendable=2
    ),
    "saturation": Fault(
        (("saturation",),), _set("saturation"), (0.8, 0.6, 0.35), (0.75, 0.55, 0.4)
    ),
    "light from outside": Fault(
        (("outside",),), lit_by_lamp, (0.05, 0.2, 0.8), (0.07, 0.25, 0.7), False
    ),
    "self-absorption": Fault((GAS,), self_absorbed, (0.15, 0.3, 0.6), (0.2, 0.4, 0.8), False),
    "absorption": Fault((GAS,), absorbed, (0.2, 0.5, 1.0), (0.15, 0.4, 0.9), False),
    "vignetting": Fault(
        (("fall-off",),), _set_all("vignetting"), (0.15, 0.35, 0.6), (0.2, 0.4, 0.55), False
    ),
    "blur": Fault((("blur",),), _set("blur"), (0.8, 1.6, 3.2), (0.9, 1.8, 3.0)),
    "out of step": Fault(
        (("out of step", *APART),), out_of_step, (0.5, 1.2, 3.0), (0.6, 1.5, 2.5), mendable=0
    ),
    "magnified": Fault((LENS,), _moved(magnified), (0.01, 0.05, 0.12), (-0.01, 0.05, -0.12)),
    "all magnified": Fault(
        (LENS,), all_magnified, (0.01, 0.05, 0.12), (-0.01, 0.05, -0.12), False, mendable=0
    ),
    "frame before two": Fault((("hidden",),), framed, (0.1, 0.25, 0.5), (0.12, 0.3, 0.45)),
    "ghost": Fault(
        (("scatter", *APART),), _set("ghost"), (0.03, 0.06, 0.12), (0.025, 0.05, 0.1), mendable=0
    ),
    "veil": Fault(
        (("scatter", "background", *APART),), _set("veil"), (0.1, 0.25, 0.6), (0.08, 0.3, 0.5)
    ),
    "dark gradient": Fault(
        (BACKGROUND,), _set("gradient"), (0.02, 0.05, 0.12), (0.015, 0.06, 0.1)
    ),
    "hot column": Fault((("bad pixels",),), hot_column, (0.05, 0.2, 0.8), (0.07, 0.25, 0.6)),
    "motion": Fault((("blur",),), smeared, (3, 5, 9), (3, 7, 11)),
    "gamma": Fault(
        (("gamma",),), _set_all("gamma"), (1.2, 1.6, 2.2), (1.25, 1.8, 2.4), False, mendable=0
    ),
    "cloud": Fault((GAS,), clouded, (0.2, 0.5, 1.2), (0.25, 0.6, 1.5), False),
    "sheath": Fault(
        (GAS,), sheathed, (0.2, 0.5, 1.2), (0.25, 0.6, 1.5), False, mendable=0
    ),  # mostly one factor on all rays, which no image can tell
    "two at once": Fault((("gain",), POSE), two_at_once, (0.7, 1.4, 4.0), (0.8, 1.5, 3.5)),
    "cap": Fault((("dark", "hidden"),), capped, (1, 2, 3), (1, 2, 3), mendable=0),
    "one file twice": Fault((ORDER,), doubled, (0.08, 0.25, 0.4), (0.12, 0.2, 0.35), mendable=0),
}
"""Sizes: gain as a factor; backgrounds, gradient and hot column in full scales; shift in pixels,
roll and pose in degrees; swapped and one file twice as a fraction of the rig; hidden as a fraction
of the flame's width, framed of its width and height; saturation and light from outside over the
brightest; optical depths; vignetting as the corners' loss; blur and motion in pixels; out of step
in voxels; magnification as a fraction of the focal length; ghost and veil as fractions of the
light; gamma as the curve's exponent; two at once in pixels of the second camera."""

OPTICS: Mapping[str, Fault] = {
    "unequal vignettes": Fault(
        (("fall-off",),), unequally_dimmed, (0.3, 0.6, 0.8), (0.25, 0.55, 0.75), False
    ),
    "veils": Fault((("scatter",),), _set_all("veil"), (0.1, 0.25, 0.6), (0.08, 0.3, 0.5), False),
    "refraction": Fault((APART,), bent, (0.2, 0.5, 1.0), (0.25, 0.6, 0.9), False),
    "defocus": Fault((("blur",),), _set_all("blur"), (0.8, 1.6, 3.2), (0.9, 1.8, 3.0), False),
}
"""Faults of all cameras that are no part of the judge's design: what learned optics are tried on.
Sizes: the largest corners' loss of any camera, veils as fractions of the light, refraction in
voxels by which rays are off where they leave, defocus in pixels."""

KNOWN: Mapping[str, Fault] = {**FAULTS, **OPTICS}

SIZES = 3  # how many each fault has
