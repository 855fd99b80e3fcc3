"""Scans in memory: the same bits as through files, from images to volumes."""

from dataclasses import replace

import numpy as np
import pytest

import tomo
from phantoms import create
from rigs import ring
from tomo import Corrections, Options, Scan, VoxelGrid, load_scan

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((6, 10, 6), 1.0)
RIG = ring(4, distance=100.0, image_size=(20, 30), footprint=0.5)
RANDOM = np.random.default_rng(0)
IMAGES = {name: RANDOM.random((2, 30, 20)).astype(np.float32) for name in RIG.names}
COUNTS = {name: (4000 * stack).astype(np.uint16) for name, stack in IMAGES.items()}
MASKS = {name: RANDOM.random((30, 20)) > 0.1 for name in RIG.names}
DARK = {name: np.full((30, 20), 0.01, np.float32) for name in RIG.names}


def assert_same(scan, other):
    for frame in scan.frame_names:
        for one, two in zip(scan.read(frame), other.read(frame), strict=True):
            for left, right in zip(one, two, strict=True):
                assert left.dtype == right.dtype
                np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("images", [IMAGES, COUNTS], ids=["float", "uint16"])
@pytest.mark.parametrize("shrink", [1, 2])
def test_images_from_arrays_and_from_files_are_the_same_bits(images, shrink, tmp_path):
    corrections = Corrections(dark=DARK, flat=0.5, saturation=0.99)
    if images is COUNTS:
        corrections = Corrections(bit_depth=12, gain=2.5, dark=DARK)
    scan = Scan.from_arrays(RIG, images, GRID, masks=MASKS, corrections=corrections)
    assert scan.frame_names == ("frame_000", "frame_001")
    assert scan.holds_integers() == (images is COUNTS)
    loaded = load_scan(scan.save(tmp_path / "scan"))
    assert loaded.grid == GRID
    assert_same(scan.scaled(shrink), loaded.scaled(shrink))
    assert not (scan.masks()[0] & ~MASKS[RIG.names[0]]).any()


@pytest.mark.parametrize("how", [{}, {"bits": 10}, {"photons": 300.0}])
def test_a_simulated_scan_is_reconstructed_without_files(how, tmp_path, as_given):
    field = create("jet", 1, GRID.extent)
    scan = tomo.simulate(RIG, field, GRID, supersample=2, **how)
    options = Options(method="sirt", iterations=5, hold_out=["cam01"], **as_given)
    if "bits" in how:
        options = options.but(screen=True)
    found = tomo.reconstruct(scan, options=options)
    loaded = tomo.reconstruct(load_scan(scan.save(tmp_path / "scan")), options=options)
    np.testing.assert_array_equal(found.volume, loaded.volume)
    assert found.solution.quality == loaded.solution.quality
    assert found.report()["held_out"] == loaded.report()["held_out"]
    for one, other in zip(found.warnings, loaded.warnings, strict=True):  # but for where to write
        assert one.partition("use scan")[0] == other.partition("write into scan.yaml")[0]


def test_a_truth_on_another_grid_is_a_warning(as_given):
    scan = tomo.simulate(RIG, create("jet", 1, GRID.extent), GRID)
    other = VoxelGrid((3, 5, 3), 2.0)
    found = tomo.reconstruct(scan, other, Options(method="sirt", iterations=2, **as_given))
    assert found.warnings[0].startswith("truth: the truth is on another grid: no quality")
    assert found.truth is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"images": {**IMAGES, "cam09": IMAGES["cam00"]}}, "images: found camera 'cam09'"),
        ({"images": {**IMAGES, "cam00": np.ones((3, 4))}}, "camera cam00: found shape"),
        ({"images": {**IMAGES, "cam00": IMAGES["cam00"][:1]}}, "frames: found cam00 1, cam01 2"),
        ({"images": {}}, "frames: found none"),
        ({"masks": {"cam00": np.ones((3, 4))}}, "masks: camera cam00: found shape"),
        (
            {"masks": MASKS, "corrections": Corrections(mask=MASKS)},
            "masks: found masks in corrections too",
        ),
        ({"truth": np.ones((2, 2, 2))}, "truth: found shape"),
        ({"truth": np.ones((2, 2, 2)), "grid": None}, "expected a grid that it lies on"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes, words):
    given = {"rig": RIG, "images": IMAGES, "grid": GRID} | changes
    with pytest.raises(ValueError, match=words):
        Scan.from_arrays(**given)


def test_pixels_that_are_not_finite_are_refused_unless_masked():
    images = {name: stack.copy() for name, stack in IMAGES.items()}
    images["cam02"][0, 3, 4] = np.nan
    with pytest.raises(ValueError, match="camera cam02: image in memory: found 1 NaN"):
        Scan.from_arrays(RIG, images).read()
    usable = {"cam02": np.isfinite(images["cam02"][0])}
    assert Scan.from_arrays(RIG, images, masks=usable).images()[2][3, 4] == 0


def test_a_peak_is_saved_and_loaded_and_must_be_above_zero(tmp_path):
    scan = replace(Scan.from_arrays(RIG, IMAGES, GRID), peak=0.5)
    path = scan.save(tmp_path / "scan")
    assert load_scan(path).peak == load_scan(path).scaled(2).peak == 0.5
    path.write_text(path.read_text("utf-8").replace("peak: 0.5", "peak: 0"), "utf-8")
    with pytest.raises(ValueError, match="peak: found 0, expected a number above 0"):
        load_scan(path)


def test_what_is_in_files_is_not_saved_as_if_it_were_in_memory(tmp_path):
    scan = Scan.from_arrays(RIG, IMAGES, GRID)
    loaded = load_scan(scan.save(tmp_path / "scan"))
    with pytest.raises(ValueError, match="expected a scan in memory"):
        loaded.save(tmp_path / "again")
    with pytest.raises(ValueError, match="images shrunk 2-fold"):
        scan.scaled(2).save(tmp_path / "small")


def test_the_frame_rate_is_saved(tmp_path):
    scan = replace(Scan.from_arrays(RIG, IMAGES, GRID), frame_rate=500.0)
    assert load_scan(scan.save(tmp_path / "s")).frame_rate == 500


def test_masks_of_every_frame_are_refused():
    masks = {name: np.stack([mask, mask]) for name, mask in MASKS.items()}
    with pytest.raises(ValueError, match="masks: camera cam00: found 2, expected one"):
        Scan.from_arrays(RIG, IMAGES, GRID, masks=masks)
