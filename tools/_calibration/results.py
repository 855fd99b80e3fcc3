"""The files of the study: JSON, the page, its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from _benchmark.tables import Column, number, table, words
from _results import plain, write_json, write_text

from _calibration.cases import CASES, TARGET, TEXELS
from _calibration.claims import claims
from _calibration.rendering import Exposure
from _calibration.scenes import FOOTPRINT, IMAGE_SIZE, VOLUME

FORMAT, VERSION = "calibration-study", 1
PAGE, JSON = "calibration.md", "calibration.json"
PICTURE = "calibration/page.png"
"""A picture of what calibrate_rig wrote; taken in a browser, shown where it is there."""

_DIGITS = 6

_COLUMNS: Mapping[str, list[Column]] = {
    "rendered": [
        ("rig and boards", lambda row: _words_of(row["case"])),
        ("seed", number("seed")),
        ("images used", number("images_used")),
        ("points used", number("points_used")),
        ("left out", number("points_left_out")),
        ("detected within (px)", number("detection_error_px", 2)),
        ("RMS (px)", number("rms_px", 2)),
        ("true (mm)", number("true_ray_miss")),
        ("predicted", number("predicted_ray_miss")),
        ("halves", number("cross_ray_miss")),
        ("expected", number("cross_expected")),
        ("lenses", lambda row: _counted(row["terms"])),
    ],
    "peer": [
        ("rig and boards", lambda row: _words_of(row["case"])),
        ("seed", number("seed")),
        ("setting", words("setting")),
        ("true (mm)", number("true_ray_miss")),
        ("threw", words("threw")),
    ],
    "stereo": [
        ("corners", words("corners")),
        ("adjusted by", words("solver")),
        ("left RMS (px)", number("left_rms_px")),
        ("right RMS (px)", number("right_rms_px")),
        ("joint RMS (px)", number("joint_rms_px")),
        ("left out", number("points_left_out")),
        ("baseline", number("baseline", 5)),
        ("farthest from this project's (px)", number("farthest_px")),
        ("more than 1 px away", number("more_than_a_pixel")),
    ],
    "timing": [
        ("cameras", number("cameras")),
        ("frames", number("frames")),
        ("points", number("points")),
        ("seconds", number("seconds")),
        ("core seconds", number("core_seconds")),
        ("true (mm)", number("true_ray_miss")),
        ("predicted", number("predicted_ray_miss")),
    ],
}

_TITLES = {
    "rendered": "Rendered boards",
    "peer": "cv2.calibrateMultiview on the complete boards",
    "stereo": "OpenCV's sample pairs of a chessboard",
    "timing": "Time",
}

_TEXTS = {
    "rendered": (
        "True ray-miss: points of the volume are projected with the true cameras, the pixels cast "
        "back with those found; the RMS distance of the rays from their best common point. "
        "Predicted: from the covariance, knowing nothing of the truth. Halves: between the rigs "
        "of every other frame and of the rest, beside what the covariances let expect. RMS are of "
        "lengths in the image; `detected within` is the distance from where the point truly is."
    ),
    "peer": (
        "The same sightings, in metres, as it throws on millimetres; only images that show the "
        "whole board, as it takes missing points for data. Five, four or two coefficients of "
        "distortion, from its own lenses or those of `cv2.calibrateCamera`; what counts above is "
        "the best of the six, which only the truth can tell."
    ),
    "stereo": (
        "26 images; lengths in squares of the chessboard. Left and right are calibrated alone, "
        "too. The reference, a baseline of 3.338, is that of OpenCV from corners that "
        "`cv2.cornerSubPix` moved in windows of 11 px, which take in neighbouring corners: some "
        "end up pixels away. From corners without that, OpenCV's own adjustment gives what this "
        "project gives."
    ),
    "timing": (
        "Sightings with noise of 0.05 px, every camera seeing nearly every board; detection is "
        "not included. Other work ran on the machine: seconds are an upper bound, core seconds "
        "the time that its cores worked on the calibration."
    ),
}


def save(folder: Path, result: Mapping[str, Any]) -> dict[str, Any]:
    """Write the JSON and the page of what there is so far; return it with the claims."""
    result = plain({**result, "claims": claims(result["studies"])}, _DIGITS)
    write_json(folder / JSON, result, indent=1)
    write_text(folder / PAGE, page(result, (folder / PICTURE).exists()))
    return result


def page(result: Mapping[str, Any], picture: bool = False) -> str:
    """Return the page in Markdown; ``picture`` says whether there is one to show."""
    here, exposure = result["machine"], Exposure()
    extent = " x ".join(f"{n * s:g}" for n, s in zip(VOLUME.shape, VOLUME.spacing, strict=True))
    lines = [
        "# Calibration against the truth",
        "",
        f"Made by `python tools/calibration_study.py{result['options']}`; {here['cpu']}, "
        f"{here['cores']} cores.",
        "",
        f"Boards `{TARGET}` are rendered with Open3D's RaycastingScene: 4 x 4 distorted rays a "
        f"pixel where the print changes, {TEXELS:g} print pixels a millimetre, blur of "
        f"{exposure.blur:g} px, noise of {exposure.noise:g} grey values, 8 bits, light that falls "
        f"off by {exposure.shading:.0%} across the image. Images are {IMAGE_SIZE[0]} x "
        f"{IMAGE_SIZE[1]}; a pixel is {FOOTPRINT:g} mm wide in the middle of the volume, "
        f"{extent} mm. Every seed is another rig: focal lengths, principal points, distortion and "
        "mounts vary. Detection and calibration run as `tools/calibrate_rig.py` runs them.",
    ]
    if result["claims"]:
        columns: list[Column] = [
            ("what", words("what")),
            ("wanted", words("wanted")),
            ("found", words("found")),
            ("met", words("met")),
        ]
        lines += ["", "## Claims", "", table(result["claims"], columns)]
    for name, rows in result["studies"].items():
        if rows:
            lines += ["", f"## {_TITLES[name]}", "", _TEXTS[name], "", table(rows, _COLUMNS[name])]
    if picture:
        words_below = f"![What calibrate_rig writes of five cameras]({PICTURE})"
        lines += ["", "## The page of a calibration", "", words_below]
    return "\n".join(lines) + "\n"


def _words_of(name: str) -> str:
    return next(case.words for case in CASES if case.name == name)


def _counted(terms: Sequence[str]) -> str:
    """Return ``4 brown4, 1 radial``."""
    return ", ".join(f"{terms.count(name)} {name}" for name in dict.fromkeys(sorted(terms)))
