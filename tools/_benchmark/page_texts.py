"""What the page of results says of each study: its title, and how the figures came about."""

from __future__ import annotations

from collections.abc import Mapping

ABOUT: Mapping[str, tuple[str, str]] = {
    "projectors": (
        "Rates",
        "Rays that meet the grid, pixels half a voxel wide; medians of runs in turn. A ratio is "
        "that of rates, against the row named at the same size and number of threads; the stored "
        "matrix and the tracers use all threads, scipy one. Bandwidth is that of reading a large "
        "array in the same run.",
    ),
    "solvers_mean": (
        "Error and time of every method",
        "No inverse crime: images are simulated with several rays a pixel through voxels twice as "
        "fine. `auto` is the default, which chooses and stops without the truth; every other "
        "method has the settings that were best on seed 0 and is stopped where it is nearest to "
        "the truth; `art`, the baseline, skips nothing. Means over the other seeds, with their "
        "standard deviation; seconds since the images were in memory, tracing included, for "
        "`auto` choosing too.",
    ),
    "consistent": (
        "Exact data",
        "The images are the true voxels projected through the very matrix that is inverted: an "
        "inverse crime, to time the arithmetic. 33 views; seconds since the images were in "
        "memory, tracing included.",
    ),
    "skipping": (
        "Flames",
        "33 views. `auto` is the default as it stops by itself, the others are best-stopped.",
    ),
    "skippable": (
        "What the flames would let be left out",
        "The segments of voxels brighter than some share of the brightest one in the truth "
        "itself, which no image tells as well: so many times fewer than without skipping. The "
        "distance is that of the truth with the others at zero, before anything is reconstructed.",
    ),
    "plume": (
        "A real plume",
        "ScalarFlow's fog: each camera predicted from the four others by the default.",
    ),
    "basis_mean": (
        "Emission even within voxels, or straight between their centres",
        "No inverse crime, and less of it than elsewhere: images are simulated through voxels "
        "four times as fine. The default, which chooses and stops without the truth, by boxes and "
        "by splines, pixels weighed by their noise; stopped is the best of the classic methods of "
        "the study of mismatch, of boxes and of splines, each where it is nearest to the truth. "
        "The share is that of boxes' squared error of left-out views that splines leave: below 1 "
        "they are taken. Means over the seeds; seconds since the images were in memory, the "
        "judgement of both included for splines.",
    ),
    "scaling_edge": (
        "With the grid",
        "Images have as many pixels along their edge as the grid has voxels. Each row is a "
        "process of its own; memory is what it took at its peak beyond what it had after imports "
        "and a tiny problem, parts of which small cases use again.",
    ),
    "scaling_views": ("With views", ""),
    "threads": (
        "With threads",
        "All run in turn in one process; medians. The machine's rows hold nothing of ours: small "
        "matrices multiplied, roots that wait for each other, a large array read. Where "
        "arithmetic gains little by a second thread, what are called cores are two threads of "
        "one; where reading does, one thread reads nearly all that the memory gives.",
    ),
    "memory_target": (
        "Memory on the fly",
        "The images and two volumes are what a product and its adjoint must hold in any case.",
    ),
    "startup": (
        "Seconds",
        "With an empty cache of compiled code, and with the cache that this left.",
    ),
    "mismatch_mean": (
        "Chords against learned weights",
        "The images hold what chord lengths lack, one effect at a time or all: gains that differ "
        "by 10 %, gas that absorbs (an optical depth of 2 across the box, or of 1 through the "
        "flame for its own light), 40 % of the light lost in the corners, a blur of two voxels; "
        "pixels have an area everywhere. 33 views; no solver is told, and no gain is fitted. "
        "Classic is the best of CGLS, non-negative least squares (plain and smooth, of boxes and "
        "of splines), least squares with a penalty on relative curvature (of either), SIRT, MLEM "
        "and total variation, each stopped where it is nearest to the truth; informed is the best "
        "of the least squares and of that one, so stopped, with the true weights: about what the "
        'images allow; WERNet is `reconstruct(method="wernet")`, which stops by itself. It is '
        'asked to look for discs out of focus in the images (`blur="auto"`); beside it stands '
        "what it comes to when it is not. Means over "
        "the seeds; seconds since the images were in memory.",
    ),
    "training": (
        "Time of an epoch",
        "WERNet as its paper has it (`wernet-paper`), on the jet seen by 33 views. Padded is the "
        "paper's form: every ray as long as the longest of its step, and torch's convolutions. A "
        "form is timed in some steps of about 3200 rays, the same ones for each but for those "
        "skipped, in turn after one round that is not counted; medians, with Adam's steps and "
        "the making of the batches. An epoch is that times all its rays over those timed. "
        "Gradients are compared in the first of the steps: the largest difference of any "
        "parameter's entries, over the largest of that parameter's. Double precision says that "
        "both forms are one function; in single, as trained, each form sums in an order of its "
        "own.",
    ),
}
