"""``flametomo hull``: the visual hull of an opaque thing from its silhouettes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tomo.cli.console import finite_or_none, print_json, say
from tomo.cli.images import Corrections, Images
from tomo.cli.inputs import Box, check_output_volume
from tomo.pipeline.declared import whole

if TYPE_CHECKING:
    from tomo.scan import Scan
    from tomo.scan.images import Images as Pictures
    from tomo.scan.images import Masks

EXAMPLES = """
flametomo hull scan -o out/hull
flametomo hull --rig dinoSR_par.txt --images . --channel r --threshold 0.15
    --grid 324x382x326 --spacing 0.00025 --center -0.0255,0.0247,-0.0212
    --close 10 --grow 3 -o hull
flametomo hull --rig rig.yaml --images silhouettes --threshold 0.5
    --close 0 --grow 0 --grid 200x200x200 --spacing 0.1 -o hull
"""


def hull(
    scan: Path | None = None,
    /,
    *,
    out: Path,
    frame: str | None = None,
    threshold: float | None = None,
    close: Annotated[int, whole(0, 1000)] = 5,
    grow: Annotated[int, whole(0, 1000)] = 1,
    votes: Annotated[int, whole(1, 255)] = 1,
    json: bool = False,
    images: Images,
    corrections: Corrections,
    box: Box,
) -> None:
    """Find the voxels of an opaque thing that no silhouette excludes.

    Writes the hull, 1 inside and 0 outside, as hull.npz, hull.vti and hull.nrrd. hull.json has
    the intersection over union of each silhouette and the hull's image.

    Parameters
    ----------
    frame : FRAME
        The moment; the first by default.
    threshold : LEVEL
        Pixels above it see the thing, in full scales of integers; by default what parts bright
        from dark pixels best (Otsu).
    close : PIXELS
        Gaps up to twice as wide are closed, and holes filled; 0: neither.
    grow : PIXELS
        By how much silhouettes grow, for cameras that point wrongly by as much.
    votes : N
        Views that must exclude a voxel.
    """
    from rigs.files import whole_folder
    from rigs.files.text import write_json
    from tomo.hull.opaque import otsu, silhouette, visual_hull
    from tomo.io import write_volume

    found = corrections.of(images.scan(scan))
    check_output_volume(out, found.rig, found.source)
    voxels = box.voxels(found.grid)
    pictures, masks = _seen(found, frame)
    level = otsu(pictures) if threshold is None else threshold
    outlines = [silhouette(one, level, close=close, grow=grow) for one in pictures]
    result = visual_hull(tuple(found.rig), outlines, voxels, masks, votes=votes)
    edge = voxels.spacing
    overlaps = [finite_or_none(float(one)) for one in result.overlaps]
    views = dict(zip(found.rig.names, overlaps, strict=True))
    report = {
        "iou": finite_or_none(float(result.overlaps.mean())),
        "views": views,
        "threshold": level,
        "voxels_inside": int(result.inside.sum()),
        "volume": float(result.inside.sum() * edge[0] * edge[1] * edge[2]),
        "volume_unit": f"{found.rig.length_unit}^3",
    }
    with whole_folder(out, last=("hull.json",)) as staging:
        for suffix in (".npz", ".vti", ".nrrd"):
            write_volume(staging / f"hull{suffix}", result.inside, voxels, found.rig.length_unit)
        write_json(staging / "hull.json", report, indent=2)
    worst = min(views.items(), key=lambda one: -1.0 if one[1] is None else one[1])
    said = "undefined" if report["iou"] is None else f"{report['iou']:.4f}"
    say(
        f"hull: {report['voxels_inside']:,} voxels, {report['volume']:.4g} "
        f"{report['volume_unit']}; intersection over union of silhouettes and hull {said}, "
        f"least of {worst[0]}{'' if worst[1] is None else f' ({worst[1]:.4f})'}"
    )
    if json:
        print_json(report)


def _seen(scan: Scan, frame: str | None) -> tuple[Pictures, Masks]:
    """Return images and masks of a frame; pixels at full scale see the thing, however bright."""
    import numpy as np

    pictures, masks = scan.read(frame)
    images = scan.frame(frame).images
    for place, camera in enumerate(scan.rig):
        name, size = camera.name, scan.recorded_sizes[camera.name]
        full = scan.corrections.corrected(images[name], name, size, scan.source)[2]
        given = scan.corrections.pixels("mask", name, size)
        seen = full if given is None else full & (given != 0)
        brightest = pictures[place].max(initial=1)
        pictures[place] = np.where(seen, brightest, pictures[place])
        masks[place] = masks[place] | seen
    return pictures, masks
