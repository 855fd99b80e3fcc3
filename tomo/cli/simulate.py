"""``flametomo simulate``: images that a rig's cameras take of a known emission."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tomo.cli.console import JsonFlag, print_json
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import (
    VOLUME_HELP,
    CenterOption,
    GridOption,
    RigOption,
    SpacingOption,
    load_rig_and_grid,
    parse_grid,
    read_volume_in,
)
from tomo.cli.outputs import check_output_volume

if TYPE_CHECKING:
    from phantoms.field import Field
    from rigs import Rig
    from tomo.grid import VoxelGrid
    from tomo.scan import Scan

EXAMPLES = """
flametomo simulate --rig paper33_pitch --phantom turbulent -o scan
flametomo simulate --rig rig.yaml --phantom jet --grid 30x140x30
    --spacing 0.5 --photons 2000 --seed 3 -o scan
flametomo simulate --rig rig.yaml --phantom turbulent --grid 30x140x30
    --spacing 0.5 --aperture-rays 64 -o scan
flametomo simulate --rig paper11_22deg --phantom turbulent --grid 30x140x30
    --spacing 0.5 --photons 300 --frames 200 -o film
"""


def simulate(
    rig: RigOption,
    phantom: Annotated[
        str, typer.Option(metavar="NAME", help=f"A phantom's name, or a file. {VOLUME_HELP}")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="The scan to write.")],
    grid: GridOption = None,
    spacing: SpacingOption = None,
    center: CenterOption = None,
    supersample: Annotated[
        int, typer.Option(help="Rays along each side of a pixel.", min=1, max=64)
    ] = 1,
    refine: Annotated[
        int,
        typer.Option(help="Divide each voxel's edge by this for the projection.", min=1, max=64),
    ] = 1,
    noise: Annotated[float, typer.Option(help="White noise, as a fraction of the maximum.")] = 0.0,
    photons: Annotated[
        float | None, typer.Option(help="Photons in the brightest pixel, for photon noise.")
    ] = None,
    read_noise: Annotated[
        float, typer.Option(help="Read noise in electrons, with --photons.")
    ] = 0.0,
    bits: Annotated[int | None, typer.Option(help="Quantise to 8, 12 or 16 bits.")] = None,
    gain_spread: Annotated[
        float, typer.Option(help="Relative standard deviation of the cameras' gains.")
    ] = 0.0,
    absorption: Annotated[
        float, typer.Option(help="Absorption of the gas in the whole box, per length unit.")
    ] = 0.0,
    self_absorption: Annotated[
        float, typer.Option(help="Absorption per length unit and unit of emission.")
    ] = 0.0,
    vignetting: Annotated[
        float, typer.Option(help="Fraction of the light lost in the images' corners.")
    ] = 0.0,
    aperture: Annotated[
        float | None,
        typer.Option(
            help="Diameter of the lenses; 0 for pinholes. With --aperture-rays by default that of "
            "each camera's optics in the rig."
        ),
    ] = None,
    aperture_rays: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Rays of a pixel over the aperture; by default 32 with --aperture, else none.",
            min=1,
            max=4096,
        ),
    ] = None,
    focus_distance: Annotated[
        float | None, typer.Option(help="Distance in focus of lenses; the rig's if absent.")
    ] = None,
    fresnel: Annotated[
        bool | None,
        typer.Option(
            help="Glass of the rig's scene takes what it reflects; as it says if absent."
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Seed of the phantom, the gains and the noise.", min=0)
    ] = 0,
    tracer: Annotated[str, typer.Option(help="march, raycast or reference.")] = "march",
    device: Annotated[
        str,
        typer.Option(
            metavar="DEVICE",
            help="Where rays are projected: cpu, cuda, cuda:N, the GPU of that number, or auto.",
        ),
    ] = "cpu",
    frames: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Frames of a film; one still frame by default.", min=1, max=10**6
        ),
    ] = None,
    frame_rate: Annotated[
        float | None, typer.Option(help="Frames a second, with --frames; 10000 by default.")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Simulate the images that a rig's cameras take of a phantom.

    Writes a scan folder: scan.yaml, rig.yaml, the images, and the phantom as the truth. With
    --frames, a film of the moving phantom: a TIFF stack a camera, and the truth of every frame.
    """
    started = time.perf_counter()
    with bad_input_in_one_line():
        from tomo.simulation import simulate_film, simulate_images
        from tomo.simulation.effects import OPTICS, Effects
        from tomo.simulation.film import FRAME_RATE

        optics: float | str = 0.0 if aperture_rays in (None, 1) else OPTICS
        effects = Effects(
            gain_spread=gain_spread,
            absorption=absorption,
            self_absorption=self_absorption,
            vignetting=vignetting,
            aperture=optics if aperture is None else aperture,
            focus_distance=focus_distance,
            aperture_rays=Effects.aperture_rays if aperture_rays is None else aperture_rays,
        )
        loaded, default = load_rig_and_grid(rig)
        if fresnel is not None:
            loaded = loaded.with_fresnel(fresnel)
        check_output_volume(out, loaded, rig)
        volume = _read_volume(phantom, loaded, spacing, center)
        voxels = parse_grid(grid, spacing, center, default=volume[1] if volume else default)
        field = _field(phantom, volume, voxels, seed)
        rays = {"supersample": supersample, "refine": refine, "tracer": tracer, "device": device}
        noises = {"noise": noise, "photons": photons, "read_noise": read_noise, "bits": bits}
        settings = {"effects": effects, "seed": seed, **rays, **noises}
        if frames is None and frame_rate is not None:
            raise ValueError(f"--frame-rate: found {frame_rate}, expected --frames with it")
        settings["progress"] = True
        if frames is None:
            scan = simulate_images(loaded, field, voxels, **settings)
            summary = _summary(scan, voxels, scan.save(out))
        else:
            rate = FRAME_RATE if frame_rate is None else frame_rate
            timing = {"frames": frames, "frame_rate": rate}
            written = simulate_film(loaded, field, voxels, out, **timing, **settings)
            summary = {"scan": str(written), "cameras": list(loaded.names), **timing}
            summary["grid"] = voxels.to_mapping()
    if json:
        print_json({**summary, "seconds": time.perf_counter() - started})


def _summary(scan: Scan, voxels: VoxelGrid, folder: Path) -> dict[str, Any]:
    """Return what was simulated, for ``--json``."""
    return {
        "scan": str(folder),
        "cameras": list(scan.images),
        "grid": voxels.to_mapping(),
        "maximum": max(float(image.max()) for image in scan.images.values()),
        "settings": dict(scan.settings),
    }


def _read_volume(phantom: str, rig: Rig, spacing: str | None, center: str | None) -> tuple | None:
    """Return data and grid when ``phantom`` is a volume file, None when it is a name."""
    from phantoms import names
    from tomo.io.volumes import readable_endings

    if phantom in names():
        return None
    if not phantom.lower().endswith(readable_endings()):
        known = ", ".join(names())
        raise ValueError(
            f"--phantom: found {phantom!r}, expected a volume file or one of {known}; volume "
            f"files end in {', '.join(readable_endings())}"
        )
    return read_volume_in(phantom, rig, spacing, center)


def _field(phantom: str, volume: tuple | None, voxels: VoxelGrid, seed: int) -> Field:
    """Return the field; a named phantom is made for the box of the grid."""
    from phantoms import SampledField, create

    if volume is not None:
        return SampledField(*volume[:2])
    return create(phantom, seed, voxels.extent, voxels.center)
