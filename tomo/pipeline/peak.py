"""The peak that PSNR and SSIM are relative to: as stated, or the brightest measured pixel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tomo.pipeline.options import Options
from tomo.scan import Scan
from tomo.scan.corrections import counts_in_words
from tomo.scan.images import Images, Masks

STATED, BRIGHTEST = "stated", "brightest measured pixel"


@dataclass(frozen=True)
class Peak:
    """The largest value that images can have, for PSNR and SSIM.

    Attributes
    ----------
    value : float
    unit : str
        That of the images, such as ``full scales``.
    origin : str
        `STATED` or `BRIGHTEST`.
    """

    value: float
    unit: str
    origin: str = STATED


def peak_in_words(peak: Mapping[str, Any]) -> str:
    """Return the ``peak`` of ``report.json`` in words."""
    return f"{peak['value']:.4g} {peak['unit']} ({peak['origin']})"


def with_unit(figure: str, text: str) -> str:
    """Return a figure of an image with its unit: PSNR is in decibels, others are fractions.

    >>> with_unit("psnr", "31.4"), with_unit("ssim", "0.98")
    ('31.4 dB', '0.98')
    """
    return f"{text} dB" if figure == "psnr" else text


def check_peak(options: Options, scan: Scan) -> None:
    """Refuse a peak in counts where images are fractions of their full scale.

    Raises
    ------
    ValueError
        If it is above 1 and images hold integers that no gain or unit of light changes.
    """
    stated = options.peak or scan.peak
    if stated is None or stated <= 1 or not scan.in_full_scales():
        return
    where = f"{scan.source}: " if options.peak is None and scan.source else ""
    bits = scan.corrections.bit_depth
    counts = counts_in_words(stated, bits if isinstance(bits, int) else None)
    raise ValueError(
        f"{where}peak: found {stated:g}, expected at most 1, the full scale of integers; {counts}"
    )


def peak_of(
    scan: Scan, frame: str, frames: Iterable[Images], masks: Masks, options: Options
) -> Peak:
    """Return the peak: the option's, else the scan's, else the brightest usable pixel.

    ``frames`` are images as the scan's corrections leave them, and ``frame`` says their unit.
    """
    unit, stated = scan.image_unit(frame), options.peak or scan.peak
    if stated is not None:
        return Peak(stated, unit)
    brightest = max(
        float(image.max(where=mask, initial=0.0))
        for images in frames
        for image, mask in zip(images, masks, strict=True)
    )
    return Peak(max(brightest, float(np.finfo(np.float32).tiny)), unit, BRIGHTEST)
