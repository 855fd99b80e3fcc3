"""The page: claims, then each part's tables beside its figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from _benchmark.tables import Column, number, significant, table, words

from _paper.cases import FINER
from _paper.claims import short
from _paper.sizes import Problem, Sizes
from _paper.training import Reading

_LAYOUT: Column = ("layout", lambda row: short(row["layout"]))
_COST: list[Column] = [
    ("rays", number("rays")),
    ("segments", number("segments")),
    ("active voxels", number("active_voxels")),
    ("core seconds/epoch", number("core_seconds_per_epoch", 2)),
    ("minutes", number("seconds", 2, 1 / 60)),
]
_REACHED: list[Column] = [
    ("epochs", number("epochs")),
    ("cosine distance", number("cosine_distance")),
    ("best", number("best_cosine_distance")),
    ("at epoch", number("best_epoch")),
    ("NRMSE", number("nrmse")),
    ("residual", lambda row: significant(row["course"][-1][2]) if row["course"] else "–"),
]
_NORMALISED: Column = ("gradient normalisation", words("normalise_gradient"))

_READING: list[Column] = [
    ("reading", words("reading")),
    ("steps/epoch", number("steps_per_epoch")),
    *_REACHED,
    ("core seconds/epoch", number("core_seconds_per_epoch", 2)),
]
_IMAGES: Column = ("images", lambda row: "finer" if row["layout"].endswith(FINER) else "as above")

_COLUMNS: Mapping[str, list[Column]] = {
    "readings": _READING,
    "noisy_readings": [("flame", words("flame")), *_READING],
    "layouts": [_LAYOUT, *_REACHED, *_COST],
    "views": [_LAYOUT, *_REACHED, *_COST],
    "ablation": [("variant", words("variant")), *_REACHED, *_COST],
    "first_steps": [
        ("variant", words("variant")),
        _NORMALISED,
        ("first loss", lambda row: significant(row["losses"][0])),
        ("last loss", lambda row: significant(row["losses"][-1])),
        ("steps", lambda row: f"{len(row['losses'])}"),
        ("cosine distance", number("cosine_distance")),
    ],
    "normalisation": [_NORMALISED, *_REACHED, *_COST],
    "denoising": [
        ("flame", words("flame")),
        _IMAGES,
        ("rays a step", number("samples_per_batch", scale=100)),
        *_REACHED,
        *_COST,
    ],
    "art": [
        ("flame", words("flame")),
        _IMAGES,
        ("on", words("on")),
        ("segments", number("segments")),
        ("relaxation", number("relaxation", 1)),
        ("sweeps", number("sweeps")),
        ("stopped", lambda row: _STOPPED[row["stopped"]]),
        ("cosine distance", number("cosine_distance")),
        ("NRMSE", number("nrmse")),
    ],
    "transfer": [
        ("encoder of", words("encoder_of")),
        ("flame", words("flame")),
        ("frozen", words("frozen")),
        *_REACHED,
        ("core seconds/epoch", number("core_seconds_per_epoch", 2)),
    ],
    "homogeneous": [("set", words("flame")), *_REACHED, *_COST],
}

_STOPPED = {"best": "nearest to the truth", "plain": "not by the truth"}
_OPTION = {"full": "", "half": " --half", "quick": " --quick"}

TITLES = {
    "readings": "Readings of the text",
    "noisy_readings": "Readings of the text, noise of 10 % of the maximum",
    "layouts": "Jet, three layouts of 33 cameras",
    "views": "Turbulent flame, 33 and 11 views",
    "ablation": "Without bias, bias and mask, batch normalisation",
    "first_steps": "Gradient normalisation: the first steps",
    "normalisation": "Gradient normalisation: whole runs",
    "denoising": "Noise of 10 % of the maximum: WERNet",
    "art": "Noise of 10 % of the maximum: ART",
    "transfer": "Encoders of other flames",
    "homogeneous": "The random homogeneous set that gave an encoder",
}


def page(result: Mapping[str, Any], plots: Mapping[str, Sequence[str]], sizes: Sizes) -> str:
    """Return the page in Markdown.

    Parameters
    ----------
    result : mapping
        What `_paper.results.save` writes.
    plots : mapping
        The figures of each study, as paths from the page.
    sizes : Sizes
        What the run was asked for.
    """
    here = result["machine"]
    lines = [
        "# The WERNet paper, run again",
        "",
        _about(sizes),
        "",
        f"Made by `python tools/paper.py{_OPTION[result['size']]}`; {here['cpu']}, "
        f"{here['cores']} cores, {result['threads']} thread"
        f"{'s' if result['threads'] > 1 else ''} of PyTorch. Other work ran on the machine: "
        "minutes are upper bounds; core seconds are the time that its cores worked on the run.",
    ]
    if result["claims"]:
        columns: list[Column] = [
            ("what", words("what")),
            ("the paper", words("paper")),
            ("here", words("ours")),
            ("holds", words("holds")),
            ("why not", words("why")),
        ]
        lines += ["", "## Claims", "", "Distances are cosine distances, 1 - similarity.", ""]
        lines.append(table(result["claims"], columns))
    for record in result["parts"].values():
        for name, rows in record["studies"].items():
            if rows:
                lines += _study(name, rows, plots.get(name, ()), sizes)
    return "\n".join(lines) + "\n"


def _study(name: str, rows: Sequence[Mapping], plots: Sequence[str], sizes: Sizes) -> list[str]:
    title, text = TITLES[name], _TEXTS.get(name)
    lines = ["", f"## {title}", *(["", text(sizes)] if text else [])]
    lines += ["", table(rows, _COLUMNS[name])]
    for plot in plots:
        lines += ["", f"![{title}]({plot})"]
    return lines


def _about(sizes: Sizes) -> str:
    reading, epochs = Reading(), sizes.epochs_in_full
    if sizes.large == sizes.problem:
        where = f"All flames are of {_problem(sizes.problem)}, but for the readings."
    else:
        where = (
            f"The jet's layouts and the noisy images are of {_problem(sizes.large)}. To save "
            f"time, every other part is of {_problem(sizes.problem)}."
        )
    where += (
        " Pixels are as wide as voxels. `finer` images are shrunk half as much: pixels half as "
        "wide, four times as many rays."
    )
    points = [
        "Flames are this project's phantoms, not the paper's data: `phantoms.create` with `jet`, "
        "`turbulent`, `homogeneous`.",
        where,
        "Images are the true voxels projected through the chord lengths of those same voxels, "
        "which is taken to be the paper's way: there is no error of discretisation, which real "
        "images have.",
        "Voxels that dark pixels prove empty, and their rays, are left out (`tomo.hull.carve`).",
        "One seed, 0, for flame, noise, encoder and order of the rays.",
        "What the text leaves open was decided on the jet, and used where a table says nothing "
        "else: "
        f"`{reading.variant}`, {reading.blocks} blocks, {reading.samples_per_batch} x 100 rays a "
        "step, PyTorch's initial weights but for the last bias, which starts at "
        f"{reading.first_bias}, uniform random voxels, the gradient's norm over each ray's own "
        "weights, mean squared error.",
        f"Not the text's: {reading.inputs} inputs instead of indices and midpoints as they are, "
        f"and a learning rate of {reading.encoder_learning_rate:g} for the encoder, where the "
        f"paper has 0.0005. The voxels' rate is the paper's {reading.voxel_learning_rate:g}. The "
        "last rows of the readings show what the text's own figures give.",
        f"The jet's layouts ran {epochs} epochs, all else as many as the tables say: fewer than "
        "the paper's 80, to save time. Both learning rates halve every 5 epochs"
        + _left_of_rates(sizes)
        + ".",
    ]
    title = (
        'Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a '
        'Semi-Case-Wise and Learning-Based Way", arXiv 2010.00893: its experiments, with '
        "`tomo.wernet.paper.wernet_paper`."
    )
    return "\n".join([title, "", *(f"- {point}" for point in points)])


def _left_of_rates(sizes: Sizes) -> str:
    counts = {sizes.finer_epochs, sizes.epochs, sizes.transfer_epochs, sizes.epochs_in_full}
    left = [f"1/{2 ** (n // 5):,} is left after {n}" for n in sorted(counts) if n >= 5]
    return ": " + ", ".join(left) if left else ""


def _problem(problem: Problem) -> str:
    counts = " x ".join(str(n) for n in problem.grid_shape)
    return (
        f"{counts} voxels of {problem.spacing:g} mm, seen in the presets' images shrunk "
        f"{problem.shrink}-fold"
    )


_TEXTS: Mapping[str, Callable[[Sizes], str]] = {
    "readings": lambda sizes: (
        f"The jet on {_problem(sizes.readings)}, {sizes.reading_epochs} epochs. Each row changes "
        "what it names in the one chosen. 3200 rays a step, 32 samples of 100, are the paper's; "
        "its images gave it at least 96 steps an epoch, for which `the text's figures, small "
        "steps` stands. `no norm`: without gradient normalisation. With absolute inputs the "
        "encoder can hide a smooth factor in the weights."
    ),
    "noisy_readings": lambda sizes: (
        "Both flames, otherwise as above; chosen on another phantom and noise. Steps of 3200 rays "
        "take in less noise than steps of 200. Smaller rates, batch normalisation and the text's "
        "own figures gain nothing, or next to nothing: the voxels are free, and the more exactly "
        "rays are fitted, the more of their noise is. Only more rays a voxel average it: on finer "
        "images, four times as many, about a third of the distance is left, with the text's own "
        "inputs more. `10 % the limit` is noise of a standard deviation of 5.8 %, that of uniform "
        "noise of at most 10 %, as the paper's could be read too."
    ),
    "layouts": lambda _: (
        "In the level layout the middles of the images' rows fall, at the axis, on the faces "
        "between voxel layers, in every view alike: a ray is in one layer before the axis and in "
        "the next behind it. One row less at the images' top (`level shifted`) puts the rows at "
        "the layers' middles, and nothing else; in the finer images no row falls on a face. The "
        "likely reason: height in the voxel tells the encoder how deep a segment is, so that a "
        "smooth factor can hide in the weights, as with absolute inputs. The difference is "
        "smooth but for a jump at the cameras' own height, and the residual no larger than that "
        "of `pitch`. The finer images are 92 steps of 3200 rays, the paper's were 96 or more: "
        "they are likely nearer to what the paper had, and the level layout is then no harder "
        "than the others."
    ),
    "views": lambda _: "The 11 views cover 121, 242 and 363 degrees.",
    "first_steps": lambda _: (
        "The loss of each step of the first epoch. Adam takes the steps, as in the paper."
    ),
    "denoising": lambda _: (
        "White noise whose standard deviation is a tenth of the brightest pixel, in every pixel. "
        "Carving smooths the noisy images and lets views vote; rays of dark pixels are left out. "
        "`best` is the epoch nearest to the truth, which only a known truth can tell. 3200 rays a "
        "step are the paper's, and so, nearly, is the number of rays in the finer images."
    ),
    "art": lambda _: (
        "Kaczmarz sweeps with non-negativity. Stopped nearest to the truth, with the best of the "
        "relaxations 0.01, 0.03, 0.1 and 0.3: the best that ART can do here. Not relaxed, every "
        "ray's step is taken in full, and the noise of the last rays stays: how the paper's ART "
        "was relaxed and stopped is not said."
    ),
    "transfer": lambda sizes: (
        "The encoder comes from a training of its own on the other flame "
        f"({sizes.epochs} epochs; the homogeneous set {sizes.homogeneous_epochs}); voxels start "
        "afresh. `frozen`: only the voxels are trained."
    ),
}
