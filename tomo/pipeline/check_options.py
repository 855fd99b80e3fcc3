"""Options against each other, a scan and a grid, and whether cameras can be right.

Refusals come before any image is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from rigs.aperture import check_apertures
from rigs.check import convention_errors_in
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, VOXEL, choose_form
from tomo.pipeline.coarse import FEWEST_VIEWS
from tomo.pipeline.declared import comparison
from tomo.pipeline.methods import AUTO, Method, method_named, method_names
from tomo.pipeline.options import Options
from tomo.pipeline.place import check_device
from tomo.scan import Scan
from tomo.scan.corrections import counts_in_words
from tomo.uncertainty import AUTO_REPEATS

if TYPE_CHECKING:
    from tomo.wernet.settings import Learning

_ALL, _NOMINAL, _NONE = "all", "nominal", "none"


def check_options(options: Options, scan: Scan, grid: VoxelGrid | None) -> None:
    """Refuse options that contradict each other, or that a scan or a grid does not allow."""
    methods = methods_of(options)
    repeats_of(options)
    if options.frames is not None and options.frame is not None:
        raise ValueError(
            f"frame: found {options.frame!r} with frames {options.frames!r}, expected one of both"
        )
    check_device(options.device, methods)
    learning_of(options)
    _check_hold_out(options, scan)
    if not options.skip and options.carving != AUTO:
        raise ValueError(
            f"carving: found {options.carving} where nothing is left out (skip is False), "
            "expected auto"
        )
    _check_basis(options, methods)
    if options.aperture_rays > 1:
        _check_aperture(options, scan)
    cameras_to_refine(options, scan)
    _check_peak(options, scan)
    if grid is None:
        raise ValueError(
            f"{scan.where}grid: found none in the scan or its rig, expected one: "
            "grid=VoxelGrid(shape, spacing)"
        )
    choose_form(  # before coarser grids, or single steps, are refused in its place
        tuple(camera for camera in scan.rig if camera.name not in options.hold_out),
        grid,
        wanted=options.projector,
        needs_matrix=any(one.needs_matrix for one in methods),
        **options.rays,
        midpoints=any(one.needs_midpoints for one in methods),
    )


def methods_of(options: Options) -> list[Method]:
    """Return the method of the reconstruction, and then those to compare it with."""
    others = [method_named(comparison(one)[0]) for one in options.compare]
    return [method_named(options.method), *others]


def repeats_of(options: Options) -> int:
    """Return how often the solve is repeated with new noise; by ``auto`` a few for auto alone."""
    method = method_named(options.method)
    if options.uncertainty == AUTO:
        # choosing has cost auto more than that; another method may run for hours
        return AUTO_REPEATS if method.name == AUTO else 0
    if options.uncertainty and method.needs_midpoints:
        raise ValueError(
            f"uncertainty: found {options.uncertainty} repeats, expected 0 or auto for method "
            f"{method.name}: learned weights are not learned again for each repeat"
        )
    return cast("int", options.uncertainty)  # the only word is AUTO


def cameras_to_refine(options: Options, scan: Scan) -> tuple[str, ...]:
    """Return the cameras to refine: those asked for that are not held out."""
    if options.refine_cameras in (None, (_NONE,)):
        return ()
    asked = tuple(name for name in options.refine_cameras or () if name != _NONE)
    names = _named_cameras(asked, scan)
    left = tuple(name for name in names if name not in options.hold_out)
    if not left:
        found = f"only cameras held out: {', '.join(names)}" if names else "no camera"
        raise ValueError(
            f"{scan.where}refine_cameras: found {found}, expected one to reconstruct from"
        )
    views = len(scan.rig) - len(set(options.hold_out))
    if views < FEWEST_VIEWS:
        raise ValueError(
            f"{scan.where}refine_cameras: found {views} views to refine with, expected at "
            f"least {FEWEST_VIEWS}"
        )
    return left


def _named_cameras(names: tuple[str, ...], scan: Scan) -> tuple[str, ...]:
    """Return the cameras of a scan that ``all``, ``nominal`` or names stand for."""
    if names == (_ALL,) and _ALL not in scan.rig.names:
        return tuple(scan.rig.names)
    if names == (_NOMINAL,) and _NOMINAL not in scan.rig.names:
        nominal = tuple(camera.name for camera in scan.rig if camera.status == _NOMINAL)
        if not nominal:
            raise ValueError(
                f"{scan.where}refine_cameras: found no nominal camera in the rig, expected some"
            )
        return nominal
    _check_names("refine_cameras", names, scan)
    return names


def _check_basis(options: Options, methods: list[Method]) -> None:
    """Refuse a lens or the linear basis where a method goes ray by ray, and both at once."""
    ray_by_ray = [one.name for one in methods if not one.through_lenses]
    if options.blur and ray_by_ray:
        raise ValueError(
            f"blur: found {options.blur}, expected 0 for method {ray_by_ray[0]}: it goes ray by "
            "ray"
        )
    why = f"method {methods[0].name} goes ray by ray" if not methods[0].through_lenses else ""
    if options.blur:
        why = f"blur {options.blur} is known for voxels alone"
    if options.basis == LINEAR and why:
        raise ValueError(f"basis: found {LINEAR}, expected {VOXEL}: {why}")


def _check_aperture(options: Options, scan: Scan) -> None:
    """Refuse rays over apertures that the rig does not name, or whose blur is also given."""
    if options.blur:
        raise ValueError(
            f"blur: found {options.blur} with aperture_rays {options.aperture_rays}, expected 0: "
            "rays over the aperture model the same blur"
        )
    try:
        check_apertures(scan.rig)
    except ValueError as error:
        raise ValueError(
            f"{scan.where}aperture_rays: found {options.aperture_rays}: {error}"
        ) from None


def learning_of(options: Options) -> Learning | None:
    """Return what the file of ``wernet_settings`` holds, for the method of the reconstruction."""
    from tomo.wernet.settings import Learning

    if options.wernet_settings is None:
        return None
    if not method_named(options.method).needs_midpoints:
        able = [one for one in method_names() if method_named(one).needs_midpoints]
        raise ValueError(
            f"wernet_settings: found {options.wernet_settings}, expected none for method "
            f"{options.method}: only {' and '.join(able)} can use it"
        )
    return Learning.load(options.wernet_settings, options.method)


def _check_names(option: str, names: Sequence[str], scan: Scan) -> None:
    """Refuse names that are no cameras of a scan."""
    for name in names:
        if name not in scan.rig.names:
            known = ", ".join(scan.rig.names)
            raise ValueError(
                f"{scan.where}{option}: found camera {name!r}, expected one of {known}"
            )


def _check_hold_out(options: Options, scan: Scan) -> None:
    """Refuse to hold out cameras that are not there, or all of them."""
    names = scan.rig.names
    _check_names("hold_out", options.hold_out, scan)
    if set(options.hold_out) == set(names):
        raise ValueError(
            f"{scan.where}hold_out: found all {len(names)} cameras, expected at least one "
            "left to reconstruct from"
        )


def check_cameras(scan: Scan, grid: VoxelGrid, options: Options) -> list[str]:
    """Return lines on errors of unit and convention, as ``check-rig`` finds them."""
    lines = []
    for error in convention_errors_in(scan.rig, grid):
        everyone = set(error.cameras) >= set(scan.rig.names)
        who = "all cameras" if everyone else f"camera {', '.join(error.cameras)}"
        line = (
            f"{who}: {error.text}. Correct the rig or the grid; flametomo check-rig shows what "
            "the cameras see"
        )
        if everyone and options.screen:
            raise ValueError(f"{scan.where}{line}. screen=False reconstructs all the same")
        lines.append(line)
    for camera in scan.rig if options.screen else ():
        if ((camera.position > grid.lower) & (camera.position < grid.upper)).all():
            why = "".join(
                f"; {line}" for line in lines if line.startswith(f"camera {camera.name}:")
            )
            raise ValueError(
                f"{scan.where}camera {camera.name}: found its position inside the grid, expected "
                f"it outside: correct the rig, or take a smaller grid{why}. screen=False "
                "reconstructs all the same"
            )
    return lines


def _check_peak(options: Options, scan: Scan) -> None:
    """Refuse a peak above 1 where images are integers that no gain or unit of light changes."""
    stated = options.peak or scan.peak
    if stated is None or stated <= 1 or not scan.in_full_scales():
        return
    where = f"{scan.source}: " if options.peak is None and scan.source else ""
    bits = scan.corrections.bit_depth
    counts = counts_in_words(stated, bits if isinstance(bits, int) else None)
    raise ValueError(
        f"{where}peak: found {stated:g}, expected at most 1, the full scale of integers; {counts}"
    )
