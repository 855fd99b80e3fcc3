"""A scan and a reconstruction as notebooks show them."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from rigs.files.text import some
from rigs.notebook import facts, framed, times
from tomo.draw.figures import png_bytes
from tomo.draw.page import embedded, png_of
from tomo.draw.rig.thumbnails import load_thumbnails
from tomo.pipeline import Reconstruction
from tomo.pipeline.view import peak_in_words, with_unit
from tomo.report.facts import number_text
from tomo.report.result_figures import draw_deviations
from tomo.scan import Scan

_DPI = 90  # of the picture: a hundred kilobytes at most
_COLOURS = {"green": "#1a6b2d", "amber": "#8a5000", "red": "#a1201a"}

MOST = 8
"""Cameras that are shown: a row of a notebook."""

_TALLEST = 96  # pixels of a thumbnail


def reconstruction_html(outcome: Reconstruction) -> str:
    """Return what a notebook shows of a reconstruction; it loads nothing."""
    found, report = outcome.solution, outcome.report()
    figure = draw_deviations(outcome.volume, outcome.half_width, "Half-width of the 90 % interval")
    figure.set_dpi(_DPI)
    picture = (
        f'<img alt="Middle planes of the volume" src="{embedded(png_bytes(figure))}" '
        'style="max-width:100%;background:#fff;border-radius:4px;margin:6px 0;display:block">'
    )
    count = sum(view.takes_part for view in outcome.views)
    title = f"Reconstruction of {times(found.grid.shape)} voxels from {count} cameras"
    return framed(title, _verdict(report), picture, facts(_rows(report)), _warnings(report))


def _verdict(report: Mapping[str, Any]) -> str:
    """Return how far to trust the volume, and the answer: whether it explains the images."""
    sentence, parts = report["answer"]["sentence"], []
    verdict = report.get("verdict")
    if verdict:
        colour = _COLOURS[verdict["level"]]
        parts.append(
            f'<div style="border-left:6px solid {colour};padding:2px 0 2px 10px;margin:4px 0;'
            f'font-weight:600">{escape(verdict["sentence"])}</div>'
        )
    parts.append(f'<div style="max-width:52em">{escape(sentence)}</div>')
    return "".join(parts)


def _rows(report: Mapping[str, Any]) -> list[tuple[str, object]]:
    """Return the key figures by name."""
    rows: list[tuple[str, object]] = [("method", report["method"])]
    rows.append(("relative residual", _percent(report.get("relative_residual"))))
    for name, key in (("error against the truth (NRMSE)", "nrmse"),
                      ("cosine distance from the truth", "cosine_distance")):  # fmt: skip
        if (value := report["quality"].get(key)) is not None:
            rows.append((name, number_text(value)))
    for camera, figures in report["held_out"].items():
        known = [
            f"{name.upper()} {with_unit(name, number_text(figures[name]))}"
            for name in ("psnr", "ssim")
            if figures.get(name) is not None
        ]
        if known and report.get("peak"):
            known.append(f"peak {peak_in_words(report['peak'])}")
        rows.append((f"held out {camera}", ", ".join(known)))
    emission = report.get("emission") or {}
    if emission.get("total") is not None:
        unit = emission.get("total_unit", "")
        rows.append(("total emission", f"{emission['total']:.4g} {unit}".strip()))
    rows.append(("rays, active voxels", f"{report['rays']:,}, {report['active_voxels']:,}"))
    rows.append(("seconds", f"{report['seconds']['total']:.3g}"))
    return rows


def _percent(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.2%}"


def _warnings(report: Mapping[str, Any]) -> str:
    """Return the warnings, folded up."""
    lines = "".join(f"<li>{escape(line)}</li>" for line in report["warnings"])
    if not lines:
        return ""
    count = len(report["warnings"])
    words = f"{count} warning{'s' if count > 1 else ''}"
    return f'<details><summary>{words}</summary><ul style="max-width:52em">{lines}</ul></details>'


def scan_html(scan: Scan) -> str:
    """Return what a notebook shows of a scan; images that cannot be read are named instead."""
    from PIL import Image

    names = scan.rig.names[:MOST]
    sizes = sorted({camera.image_size for camera in scan.rig})
    rows: list[tuple[str, object]] = [
        ("cameras", some(scan.rig.names)),
        ("frames", some(scan.frame_names)),
        ("images", some([f"{times(size)} pixels" for size in sizes])),
    ]
    if scan.grid is not None:
        unit = scan.rig.length_unit
        rows.append(("voxels", f"{times(scan.grid.shape)} of {times(scan.grid.spacing)} {unit}"))
    rows.append(("truth", "known" if scan.truth is not None else "not known"))
    if scan.source is not None:
        rows.append(("source", scan.source))
    try:
        pictures = load_thumbnails(scan.rig, scan.only(*names), longest=_TALLEST)
    except (ValueError, OSError) as error:
        rows.append(("not readable", " ".join(str(error).split())))
        pictures = {}
    figures = "".join(
        '<figure style="display:inline-block;margin:0 6px 4px 0;text-align:center">'
        f'<img alt="{escape(name)}" src="{embedded(png_of(Image.fromarray(one)))}">'
        f'<figcaption style="font-size:.75em;opacity:.75">{escape(name)}</figcaption></figure>'
        for name, one in pictures.items()
    )
    count = f"{len(scan.frames)} frame{'s' if len(scan.frames) != 1 else ''}"
    return framed(f"Scan of {count} by {len(scan.rig)} cameras", figures, facts(rows))
