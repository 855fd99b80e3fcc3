"""The store that ``flametomo reconstruct --frames`` writes: its checks and its summary."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomo.cli.outputs import check_output_folder
from tomo.series.layout import SUFFIX

if TYPE_CHECKING:
    from rigs import Rig


def check_output_store(path: Path, rig: Rig, source: object) -> None:
    """Raise unless a store in the unit of a rig from ``source`` can be written there."""
    from tomo.io.volumes import check_length_unit

    if path.suffix != SUFFIX:
        raise ValueError(
            f"-o: found {str(path)!r}, expected a store like out{SUFFIX} with --frames"
        )
    if path.is_file():
        raise FileExistsError(f"{path}: is a file, expected a store to write")
    check_output_folder(path.parent)
    try:
        check_length_unit(rig.length_unit)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def series_summary(report: dict[str, Any]) -> str:
    """Return a line on each of: the frames, held-out cameras, the verdict, the store."""
    from tomo.pipeline.peak import peak_in_words, with_unit

    figures = (
        ("relative_residual", "mean relative residual {:.4g}"),
        ("seconds_a_frame", "{:.2f} s a frame"),
    )
    known = [words.format(report[name]) for name, words in figures if report[name] is not None]
    lines = [", ".join([f"{report['complete']} of {report['frames']} frames", *known])]
    compared = {"against the truth": report["quality"]} if report["quality"] else {}
    compared |= {f"held out {camera}": each for camera, each in report["held_out"].items()}
    for who, figures in compared.items():
        shown = ", ".join(
            f"{name} {with_unit(name, f'{value:.4g}')}" for name, value in figures.items()
        )
        shown += f", peak {peak_in_words(report['plan']['peak'])}" if "psnr" in figures else ""
        lines.append(f"{who}, mean: {shown}")
    lines.append(report["verdict"]["sentence"])
    lines.append(
        f"open {report['page']}; {report['store']} opens with xarray.open_zarr, and flametomo "
        "export writes it for other programs"
    )
    return "\n".join(lines)
