"""What may be wrong with a set of images, each in three sizes, made from faultless exposures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigs import Camera
from rigs.geometry.rotation import matrix_of_vector
from studies.scenes.exposure import Exposure
from studies.scenes.fields import LaterField, WithLamp

Exposures = tuple[Exposure, ...]


@dataclass(frozen=True)
class Setting:
    """Where a fault goes.

    Attributes
    ----------
    view : int
        The camera at fault, for faults of one camera.
    size : float
        How large the fault is, in its own unit.
    brightest : float
        The brightest pixel of the faultless images, in the field's unit.
    random : numpy.random.Generator
    """

    view: int
    size: float
    brightest: float
    random: np.random.Generator


@dataclass(frozen=True)
class Fault:
    """One kind of fault.

    Attributes
    ----------
    cause : str
        What a report should call it; several faults may have one cause.
    make : callable
        From the faultless exposures and a `Setting` to the faulty ones.
    settle, report : (float, float, float)
        The three sizes of either half, in the unit that ``make`` says.
    single : bool
        Whether it is of one camera, which a report should name.
    """

    cause: str
    make: Callable[[Exposures, Setting], Exposures]
    settle: tuple[float, float, float]
    report: tuple[float, float, float]
    single: bool = True


def _one(exposures: Exposures, view: int, **changes: object) -> Exposures:
    """Return exposures of which one is changed."""
    found = list(exposures)
    found[view] = replace(found[view], **changes)
    return tuple(found)


def _all(exposures: Exposures, **changes: object) -> Exposures:
    """Return exposures that are all changed alike."""
    return tuple(replace(one, **changes) for one in exposures)


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
    """Return exposures of which two have each other's image, a fraction ``size`` of the rig apart.

    The images have one size: a camera of another size is passed over.
    """
    views, first = len(exposures), exposures[setting.view]
    apart = max(round(setting.size * views), 1)
    order = [(setting.view + apart + step) % views for step in range(views)]
    size = first.camera.image_size
    alike = [v for v in order if v != setting.view and exposures[v].camera.image_size == size]
    if not alike:
        raise ValueError("swapped: found no two cameras of one image size, expected two")
    other = exposures[alike[0]].camera
    return _one(_one(exposures, setting.view, camera=other), alike[0], camera=first.camera)


def mirrored(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one is turned over: across (1), down (2), or both (3)."""
    way = ("across", "down", "both")[int(setting.size) - 1]
    return _one(exposures, setting.view, mirrored=way)


def lit_by_lamp(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures that see a lamp outside of the grid, ``size`` times as bright as the flame.

    Its brightest line of sight is ``size`` times the flame's.
    """
    field = exposures[0].field
    across = np.sqrt(2 * np.pi) * 1.5 * field.grid.spacing[0]
    strength = setting.size * setting.brightest / across
    return _all(exposures, field=WithLamp(field, strength, setting.random.uniform(0, 2 * np.pi)))


def self_absorbed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of gas of the optical depth ``size`` along the brightest line of sight."""
    return _all(exposures, self_absorption=setting.size / setting.brightest)


def absorbed(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures through a medium of the optical depth ``size`` across the grid."""
    return _all(exposures, absorption=setting.size / exposures[0].field.grid.extent[0])


def out_of_step(exposures: Exposures, setting: Setting) -> Exposures:
    """Return exposures of which one is of another moment: gas ``size`` voxels away."""
    later = LaterField(exposures[setting.view].field, setting.size)
    return _one(exposures, setting.view, field=later)


FAULTS: Mapping[str, Fault] = {
    "gain": Fault("gain", _set("gain"), (1.06, 0.85, 0.6), (0.93, 1.12, 0.65)),
    "background": Fault("background", _set("background"), (0.01, 0.03, 0.1), (0.008, 0.04, 0.08)),
    "dark left in": Fault(
        "background", _set_all("background"), (0.005, 0.02, 0.06), (0.007, 0.017, 0.05), False
    ),
    "shift": Fault("pointing", _moved(shifted), (0.7, 1.4, 4.0), (0.8, 1.5, 3.5)),
    "roll": Fault("pointing", _moved(rolled), (1.5, 4.0, 10.0), (2.0, 5.0, 9.0)),
    "pose": Fault("pointing", _moved(walked), (1.5, 4.0, 10.0), (2.0, 5.0, 9.0)),
    "swapped": Fault("swapped", swapped, (0.08, 0.25, 0.4), (0.12, 0.2, 0.35)),
    "mirrored": Fault("mirrored", mirrored, (1, 2, 3), (1, 2, 3)),
    "hidden part": Fault("hidden", _set("hidden"), (0.08, 0.25, 0.5), (0.1, 0.2, 0.4)),
    "saturation": Fault("saturation", _set("saturation"), (0.8, 0.6, 0.35), (0.75, 0.55, 0.4)),
    "light from outside": Fault(
        "outside", lit_by_lamp, (0.05, 0.2, 0.8), (0.07, 0.25, 0.7), False
    ),
    "self-absorption": Fault(
        "self-absorption", self_absorbed, (0.15, 0.3, 0.6), (0.2, 0.4, 0.8), False
    ),
    "absorption": Fault("absorption", absorbed, (0.2, 0.5, 1.0), (0.15, 0.4, 0.9), False),
    "vignetting": Fault(
        "vignetting", _set_all("vignetting"), (0.15, 0.35, 0.6), (0.2, 0.4, 0.55), False
    ),
    "blur": Fault("blur", _set("blur"), (0.8, 1.6, 3.2), (0.9, 1.8, 3.0)),
    "out of step": Fault("out of step", out_of_step, (0.5, 1.2, 3.0), (0.6, 1.5, 2.5)),
}
"""Sizes: gain as a factor; backgrounds in full scales; shift in pixels, roll and pose in degrees;
swapped as a fraction of the rig; hidden as a fraction of the flame's width; saturation and light
from outside over the brightest; optical depths; vignetting as the corners' loss; blur in pixels;
out of step in voxels."""

SIZES = 3
