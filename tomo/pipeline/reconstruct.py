"""From a scan to a volume: load, trace, solve, and judge the result."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

from tomo.grid import VoxelGrid
from tomo.operators.system import Progress
from tomo.pipeline.methods import AUTO
from tomo.pipeline.reconstruction import ZERO, Reconstruction
from tomo.pipeline.request import Request
from tomo.pipeline.steps import reconstruct_as_asked
from tomo.scan import Scan


def reconstruct(
    scan: Scan,
    grid: VoxelGrid | None = None,
    *,
    method: str = AUTO,
    frame: str | None = None,
    hold_out: Sequence[str] = (),
    iterations: int | None = None,
    compare: Sequence[tuple[str, int | None]] = (),
    tracer: str = "march",
    projector: str = "auto",
    skip: bool = True,
    margin: float | str = AUTO,
    dark_level: float | str = AUTO,
    votes: int | str = AUTO,
    suspects: bool = True,
    align: bool = True,
    refine_cameras: Sequence[str] | None = None,
    refine_prior: float | None = None,
    fit_gain: bool | None = None,
    weigh: bool = True,
    blur: float | str = 0.0,
    basis: str = AUTO,
    unseen: str = ZERO,
    supersample: int = 1,
    device: str = "cpu",
    encoder: str | PathLike | None = None,
    freeze_encoder: bool = False,
    checkpoint: str | PathLike | None = None,
    resume: bool = False,
    seed: int = 0,
    time_limit: float | None = None,
    uncertainty: int | str = AUTO,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct the emission in every voxel from one frame of a scan.

    Parameters
    ----------
    scan : Scan
    grid : VoxelGrid, optional
        The scan's own when None.
    method : str
        ``auto`` chooses between the classic methods, and how smooth and how long, by predicting
        views left out; or the name of one, see `tomo.pipeline.methods.method_names`.
    frame : str, optional
        The first when None.
    hold_out : sequence of str
        Cameras that are only predicted and judged; nothing else sees their images.
    iterations : int, optional
        The method's own default when None; ``auto`` then chooses.
    compare : sequence of (method, iterations)
        Further methods to run on the same rays, for the report.
    tracer : {"march", "raycast", "reference"}
        Of a stored matrix.
    projector : {"auto", "stored", "on-the-fly"}
        Whether the matrix is stored; ``auto`` stores it where it fits in memory.
    skip : bool
        Whether to leave out what cannot matter: pixels whose rays miss the grid, voxels that dark
        pixels prove empty, and the pixels that then see nothing.
    margin : float or "auto"
        Pixels around a voxel that must be dark for it to be empty; infinite: no voxel is.
    dark_level : float or "auto"
        The intensity up to which a pixel is dark.
    votes : int or "auto"
        Views that must find a voxel dark. What is ``auto`` is found from the images, see
        `tomo.hull.carve`.
    suspects : bool
        Whether to leave out wild pixels, and views that the others contradict, see
        `tomo.suspects`. A camera held out is judged, never left out.
    align : bool
        Whether to look for shifts of the images, and make them where they clearly help, see
        `tomo.selfcal.shifts`. A camera held out stays as it is.
    refine_cameras : sequence of str, optional
        Cameras to refine from the images, see `tomo.refine`, once images are shifted; nothing is
        shifted where all are refined. Those held out stay as they are.
    refine_prior : float, optional
        How far these may be from what the rig says, in pixels as a standard deviation; from the
        rig's calibration and the cameras' status when None.
    fit_gain : bool, optional
        Whether to fit each camera's gain and offset, see `tomo.selfcal.gains`; when the views
        disagree if None.
    weigh : bool
        Whether the default method, and ``wernet``, which starts from it, weigh pixels by their
        noise where it differs, as that of photons does, see `tomo.measurement.weigh_pixels`.
    blur : float or "auto"
        Diameter, at the grid's centre and in the rig's length unit, of the discs that lenses out
        of focus make of points: images are projected through them, see `tomo.defocus`. 0: in
        focus. ``auto``: what the images' spectra show; clean images of a smooth flame may look as
        if they were out of focus.
    basis : {"auto", "voxel", "linear"}
        Whether the emission is taken to be even within voxels or to run straight between their
        centres, see `tomo.splines`; `Reconstruction.volume` holds the voxels' means either way.
        ``auto``: splines where they predict left-out views clearly better.
    unseen : {"zero", "nan"}
        What `Reconstruction.volume` and the files hold where no usable ray crosses a voxel.
    supersample : int
        Rays along each side of a pixel.
    device : str
        For WERNet: cpu, cuda ... The classic methods, also beside it, run on the CPU.
    encoder : path or name, optional
        For WERNet: the encoder to start from, see `tomo.wernet.load_encoder`.
    freeze_encoder : bool
        Use it as it is.
    checkpoint : path, optional
        For the default WERNet: a file to keep the state of training in.
    resume : bool
        Go on from the checkpoint where there is one.
    seed : int
        Of everything random.
    time_limit : float, optional
        Seconds after which each solver stops at its current iteration, but not before its
        first; what ``auto`` takes to choose, and the repeats of ``uncertainty``, come on top.
    uncertainty : int or "auto"
        How often to repeat the solve with new noise, for the standard deviation of every voxel,
        and to find the resolution, see `tomo.condition`; 30 tell single voxels. ``auto``: as
        often as the figures for the whole volume need after method ``auto``, else 0.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    request = Request(
        method=method,
        frame=frame,
        hold_out=hold_out,
        iterations=iterations,
        compare=compare,
        tracer=tracer,
        projector=projector,
        skip=skip,
        margin=margin,
        dark_level=dark_level,
        votes=votes,
        suspects=suspects,
        align=align,
        refine_cameras=refine_cameras,
        refine_prior=refine_prior,
        fit_gain=fit_gain,
        weigh=weigh,
        blur=blur,
        basis=basis,
        unseen=unseen,
        supersample=supersample,
        device=device,
        encoder=encoder,
        freeze_encoder=freeze_encoder,
        checkpoint=checkpoint,
        resume=resume,
        seed=seed,
        time_limit=time_limit,
        uncertainty=uncertainty,
    )
    return reconstruct_as_asked(scan, scan.grid if grid is None else grid, request, progress)
