"""The words of a page that a reader may not know, explained at its end."""

from __future__ import annotations

import html
import re

from tomo.draw.page import render

PLACE = "<!-- glossary -->"

TERMS: tuple[tuple[str, str, str], ...] = (
    ("active voxel", r"active voxel", "A voxel whose emission is sought. The others are zero, "
     "because dark pixels prove them empty."),
    ("beyond noise", r"beyond (?:its |the )?noise", "The part of an image that neither the volume "
     "nor noise explains, as a fraction of the image. It is measured on means over 4 x 4 pixels, "
     "so that details finer than a voxel do not count. Up to 4 % is explained, above 10 % is "
     "not."),
    ("cosine distance", r"cosine distance", "Difference of two volumes that ignores brightness: 0 "
     "for equal shapes, 1 where nothing overlaps."),
    ("emission", r"emission|emit", "The light that a unit of volume sends out: what the values of "
     "the volume are."),
    ("gain", r"gain", "The factor by which a camera records brighter than the volume's image "
     "says. 1 is right."),
    ("half-width, 90 % interval", r"90 % interval", "The true value lies within plus and minus "
     "the half-width in about nine of ten voxels."),
    ("held out", r"held[- ]out", "A camera whose image the reconstruction never saw. The volume "
     "then predicts that image: the best check on real images."),
    ("image unit, full scale", r"image units?|full scales?", "The value 1 of a pixel after "
     "corrections; a full scale is the most that a camera records. Without radiometry the volume "
     "has such a unit per length: along a line of sight it adds up to the pixel."),
    ("iteration", r"iteration", "One step of the method towards the volume."),
    ("line integral, projection", r"line integral|re-projected|projected", "The volume's emission "
     "added up along a line of sight: what a pixel sees. The re-projected image is the volume as "
     "a camera would see it."),
    ("noise", r"noise", "What changes from one exposure to the next though the flame does not. It "
     "is estimated from the images."),
    ("NRMSE", r"NRMSE", "Root mean square of the error over that of the true values. 0.05 means "
     "that voxels are off by 5 % of a typical bright voxel."),
    ("PSNR", r"PSNR", "Error of a predicted image in decibels: 20 dB is an error of a tenth of "
     "the brightest pixel, 40 dB of a hundredth. More is better."),
    ("relative residual", r"residual", "The part of the images that the volume does not "
     "reproduce, noise included: root mean square of the difference over that of the image."),
    ("root mean square", r"root mean square", "A mean in which large values count more: the root "
     "of the mean of the squares."),
    ("segment", r"segments?", "The part of a line of sight within one voxel."),
    ("SSIM", r"SSIM", "Likeness of two images in structure, up to 1 for equal ones. Noise in the "
     "measured image lowers it."),
    ("standard deviation", r"standard deviation", "How far values scatter when only the noise "
     "changes: two of three lie within it."),
    ("view", r"\bviews?\b", "The image of one camera."),
    ("voxel", r"voxel", "A small box of the grid; the volume has one value for each."),
)  # fmt: skip
"""Term, the pattern that shows that a page uses it, and its meaning."""


def with_glossary(page: str) -> str:
    """Return a page with the terms that it uses in the place of its mark."""
    shown = re.sub(r"<(style|script)\b.*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    text = html.unescape(shown)
    used = [(term, words) for term, found, words in TERMS if re.search(found, text, re.IGNORECASE)]
    return page.replace(PLACE, render("glossary.html", terms=used) if used else "")
