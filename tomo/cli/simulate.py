"""``flametomo simulate``: images that a rig's cameras take of a known emission."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tomo.cli.console import print_json
from tomo.cli.inputs import Box, check_output_volume, load_rig_and_grid, read_volume_in
from tomo.pipeline.declared import whole

if TYPE_CHECKING:
    from phantoms.field import Field
    from rigs import Rig
    from tomo.grid import Volume, VoxelGrid
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
    *,
    rig: str,
    phantom: str,
    out: Path,
    supersample: Annotated[int, whole(1, 64)] = 1,
    refine: Annotated[int, whole(1, 64)] = 1,
    noise: float = 0.0,
    photons: float | None = None,
    read_noise: float = 0.0,
    bits: int | None = None,
    gain_spread: float = 0.0,
    absorption: float = 0.0,
    self_absorption: float = 0.0,
    vignetting: float = 0.0,
    aperture: float | None = None,
    aperture_rays: Annotated[int | None, whole(1, 4096)] = None,
    focus_distance: float | None = None,
    fresnel: bool | None = None,
    seed: Annotated[int, whole(0)] = 0,
    tracer: str = "march",
    device: str = "cpu",
    frames: Annotated[int | None, whole(1, 10**6)] = None,
    frame_rate: float | None = None,
    json: bool = False,
    box: Box,
) -> None:
    """Simulate the images that a rig's cameras take of a phantom.

    Writes a scan folder: scan.yaml, rig.yaml, the images, and the phantom as the truth. With
    --frames, a film of the moving phantom: a TIFF stack a camera, and the truth of every frame.

    Parameters
    ----------
    phantom : NAME
        A phantom's name, or a file. A volume file: .npz, .vti, .nrrd, .nhdr, .mha, .mhd, .npy
        with --spacing, or .nii and .nii.gz where nibabel is installed.
    out : FOLDER
        The scan to write.
    supersample : N
        Rays along each side of a pixel.
    refine : N
        Divide each voxel's edge by this for the projection.
    noise : X
        White noise, as a fraction of the maximum.
    photons : X
        Photons in the brightest pixel, for photon noise.
    read_noise : X
        Read noise in electrons, with --photons.
    bits : N
        Quantise to 8, 12 or 16 bits.
    gain_spread : X
        Relative standard deviation of the cameras' gains.
    absorption : X
        Absorption of the gas in the whole box, per length unit.
    self_absorption : X
        Absorption per length unit and unit of emission.
    vignetting : X
        Fraction of the light lost in the images' corners.
    aperture : X
        Diameter of the lenses; 0 for pinholes. With --aperture-rays by default that of each
        camera's optics in the rig.
    aperture_rays : N
        Rays of a pixel over the aperture; by default 32 with --aperture, else none.
    focus_distance : X
        Distance in focus of lenses; the rig's if absent.
    fresnel :
        Glass of the rig's scene takes what it reflects; as it says if absent.
    seed : N
        Seed of the phantom, the gains and the noise.
    tracer : TRACER
        march, raycast or reference.
    device : DEVICE
        Where rays are projected: cpu, cuda, cuda:N, the GPU of that number, or auto.
    frames : N
        Frames of a film; one still frame by default.
    frame_rate : X
        Frames a second, with --frames; 10000 by default.
    """
    started = time.perf_counter()
    from phantoms import SampledField, create
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
    volume = _read_volume(phantom, loaded, box)
    voxels = box.voxels(default if volume is None else volume.grid)
    if volume is not None:
        field: Field = SampledField(volume, volume.grid)
    else:
        field = create(phantom, seed, voxels.extent, voxels.center)
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


def _read_volume(phantom: str, rig: Rig, box: Box) -> Volume | None:
    """Return the volume when ``phantom`` is a file, None when it is a name."""
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
    return read_volume_in(Path(phantom), rig, box)
