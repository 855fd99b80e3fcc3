import json
import shutil

import numpy as np
import pytest
import tifffile
import yaml

from phantoms import GaussianBlobs, create
from rigs import load_rig, ring
from tomo import Scan, VoxelGrid
from tomo.effects import Effects
from tomo.io import read_volume, write_volume
from tomo.reconstruct import reconstruct
from tomo.simulate import simulate
from tomo.view.outcome_files import VOLUME_FILES, results_of, write_outcome

GRID = VoxelGrid((10, 20, 10), 1.0, (1.0, -2.0, 0.5))
REPORT = {
    "method", "seconds", "first_use_seconds", "peak_memory_mb", "rays", "segments", "voxels",
    "active_voxels", "relative_residual", "stop_reason", "quality", "held_out", "views",
    "versions", "seed", "settings",
}  # fmt: skip
SIRT = {"method": "sirt", "iterations": 5}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "scan"
    rig = ring(
        6,
        distance=200.0,
        image_size=(40, 60),
        footprint=0.5,
        center=GRID.center,
        pitch_degrees=[10.0, -10.0] * 3,
    )
    field = create("jet", 1, GRID.extent, GRID.center)
    simulate(rig, field, GRID, supersample=2, refine=2).save(folder)
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "scan")
    return tmp_path / "scan"


@pytest.fixture(scope="module")
def outcome(folder):
    return reconstruct(Scan.load(folder))


def _volume(scan, *arguments, **settings):
    scan = scan if isinstance(scan, Scan) else Scan.load(scan)
    return reconstruct(scan, *arguments, **settings).reconstruction.volume


def _far(volume, other):
    """Return the largest difference, relative to the largest emission."""
    return np.abs(volume - other).max() / other.max()


def _garble(path, where=True):
    pixels = tifffile.imread(path)
    garbage = np.random.default_rng(5).random(pixels.shape, np.float32) * 5 * pixels.max()
    tifffile.imwrite(path, np.where(where, garbage, pixels))


def test_the_report_holds_what_was_promised(outcome):
    report = json.loads(json.dumps(outcome.report(), allow_nan=False))
    assert set(report) >= REPORT
    assert set(report["seconds"]) >= {"load", "trace", "solve", "total"}
    assert 0 < report["seconds"]["solve"] < report["seconds"]["total"]
    assert set(report["quality"]) >= {"cosine_distance", "nrmse"}
    assert report["method"] in ("mlem", "nnls")
    assert report["settings"]["chosen_by"] == "auto"
    assert report["voxels"] == GRID.size > report["active_voxels"]
    assert report["rays"] > 0
    assert report["segments"] > report["rays"]
    assert report["peak_memory_mb"] > 50
    assert report["held_out"] == {}
    assert report["warnings"] == []
    assert list(report["views"]) == [f"cam0{n}" for n in range(6)]
    assert report["versions"]["numpy"] == np.__version__
    assert report["seed"] == 0


def test_the_volume_is_close_to_the_truth(outcome):
    assert outcome.reconstruction.quality["cosine_distance"] < 0.025
    assert outcome.reconstruction.quality["total_ratio"] == pytest.approx(1, abs=0.05)
    assert outcome.reconstruction.relative_residual < 0.17
    for view in outcome.views:
        assert view.gain == pytest.approx(1, abs=0.02)


def test_the_distances_from_the_truth_end_at_the_volume_s_own(outcome):
    (distances,) = outcome.cosine_distances
    assert len(distances) == len(outcome.reconstruction.history)
    own = outcome.reconstruction.quality["cosine_distance"]
    assert distances[-1] == pytest.approx(own, rel=1e-3)
    assert distances[0] > 10 * own


def test_a_truth_on_another_grid_is_told_and_not_compared(folder, outcome):
    coarse = VoxelGrid((5, 10, 5), 2.0, GRID.center)
    found = reconstruct(Scan.load(folder), coarse)
    assert found.warnings == ("truth.npz: the truth is on another grid: no quality figures",)
    assert found.truth is None
    assert found.report()["quality"] == {}
    # what all voxels emit together is the same on any grid
    assert 8 * found.reconstruction.volume.sum() == pytest.approx(outcome.truth.sum(), rel=0.1)


def test_a_truth_that_is_a_voxel_s_part_off_is_not_compared(copy):
    for shift, alike in ((1e-9, True), (1e-3, False)):
        moved = VoxelGrid(GRID.shape, GRID.spacing, (1e5 + shift, 0.0, 0.0))
        write_volume(copy / "truth.npz", np.ones(GRID.shape), moved)
        scan = Scan.load(copy)
        # the same scene far away, where coordinates are large
        far = VoxelGrid(GRID.shape, GRID.spacing, (1e5, 0.0, 0.0))
        rig = scan.rig.transformed(np.eye(3), np.array([1e5, 0, 0]) - GRID.center)
        scan = Scan(rig, scan.frames, truth=scan.truth, source=copy)
        assert (reconstruct(scan, far, **SIRT).truth is not None) == alike


def test_the_held_out_view_is_only_judged(copy):
    before = reconstruct(Scan.load(copy), hold_out=["cam02"])
    figures = before.report()["held_out"]["cam02"]
    assert figures["psnr"] > 30
    assert figures["ssim"] > 0.94
    assert figures["cosine"] > 0.985
    _garble(copy / "images/cam02/frame_000.tif")
    after = reconstruct(Scan.load(copy), hold_out=["cam02"])
    np.testing.assert_array_equal(after.reconstruction.volume, before.reconstruction.volume)
    assert after.reconstruction.settings == before.reconstruction.settings
    assert after.report()["held_out"]["cam02"]["psnr"] < 20
    assert [view.name for view in after.views] == [f"cam0{n}" for n in range(6)]
    assert [view.held_out for view in after.views] == [n == 2 for n in range(6)]


def test_holding_out_is_leaving_the_camera_away(folder):
    scan = Scan.load(folder)
    held_out = _volume(scan, hold_out=["cam02", "cam05"])
    np.testing.assert_array_equal(held_out, _volume(scan.without("cam02", "cam05")))
    assert _far(held_out, _volume(scan)) > 1e-3


def test_masked_pixels_never_matter(copy):
    mask = np.ones((60, 40), np.uint8)
    mask[10:25, 5:30] = 0
    tifffile.imwrite(copy / "mask.tif", mask)
    content = yaml.safe_load((copy / "scan.yaml").read_text())
    content["corrections"] = {"mask": {"cam01": "mask.tif", "cam02": "mask.tif"}}
    (copy / "scan.yaml").write_text(yaml.safe_dump(content))
    before = reconstruct(Scan.load(copy), hold_out=["cam02"])
    for camera in ("cam01", "cam02"):
        _garble(copy / f"images/{camera}/frame_000.tif", mask == 0)
    after = reconstruct(Scan.load(copy), hold_out=["cam02"])
    np.testing.assert_array_equal(after.reconstruction.volume, before.reconstruction.volume)
    assert after.report()["held_out"] == before.report()["held_out"]
    assert after.report()["views"] == before.report()["views"]
    assert before.reconstruction.quality["cosine_distance"] < 0.03
    _garble(copy / "images/cam01/frame_000.tif")  # unmasked, it does matter
    assert _far(_volume(copy, hold_out=["cam02"]), before.reconstruction.volume) > 0.05


@pytest.mark.parametrize("tracer", ["raycast", "reference"])
def test_tracers_lead_to_the_same_volume(folder, tracer):
    scan = Scan.load(folder).scaled(2)  # the reference is slow
    assert _far(_volume(scan, tracer=tracer), _volume(scan)) < 1e-4


@pytest.mark.parametrize("method", ["auto", "cgls", "sirt", "mlem", "sart"])
def test_pixels_that_miss_the_grid_change_nothing(folder, method):
    settings = {"method": method, "iterations": None if method == "auto" else 10}
    skipped = reconstruct(Scan.load(folder), margin=np.inf, **settings)
    whole = reconstruct(Scan.load(folder), skip=False, **settings)
    assert whole.counts["rays"] == 6 * 40 * 60 > skipped.counts["rays"]
    assert whole.counts["segments"] == skipped.counts["segments"]
    assert _far(whole.reconstruction.volume, skipped.reconstruction.volume) < 1e-5
    for one, other in zip(whole.views, skipped.views, strict=True):
        np.testing.assert_allclose(one.reprojected, other.reprojected, atol=1e-4)


def test_voxels_proved_empty_take_no_part_and_cost_nothing(folder):
    settings = {"method": "cgls", "iterations": 15}
    carved = reconstruct(Scan.load(folder), **settings)
    whole = reconstruct(Scan.load(folder), margin=np.inf, **settings)
    assert carved.counts["active_voxels"] < whole.counts["active_voxels"] == GRID.size
    assert carved.counts["segments"] < whole.counts["segments"]
    report = carved.report()["skipping"]
    assert report["live_voxels"] == carved.counts["active_voxels"]
    assert report["pixels_used"] < report["pixels_recorded"] == 6 * 40 * 60
    assert "are dark in" in report["reason"]
    # what was left out is empty, and what is left is found no worse
    emptied = carved.reconstruction.volume == 0
    assert np.sum(carved.truth[emptied] ** 2) < 2e-3 * np.sum(carved.truth**2)
    assert (
        carved.reconstruction.quality["cosine_distance"]
        < 1.02 * whole.reconstruction.quality["cosine_distance"]
    )


@pytest.mark.parametrize("settings", [{}, {"method": "wernet-paper", "iterations": 1, "seed": 3}])
def test_the_same_again_is_the_same_to_the_bit(folder, settings):
    volumes = [_volume(Scan.load(folder).scaled(2), **settings) for _ in range(2)]
    np.testing.assert_array_equal(*volumes)


@pytest.fixture(scope="module")
def unequal(tmp_path_factory):
    """Return the scan of ten cameras whose gains differ and are not told."""
    folder = tmp_path_factory.mktemp("unequal") / "scan"
    look = {"image_size": (20, 30), "footprint": 1.0, "pitch_degrees": [10.0, -10.0] * 5}
    rig = ring(10, distance=200.0, center=GRID.center, **look)
    field = GaussianBlobs(np.add(GRID.center, [[1, 3, -1], [-1, -4, 0.5]]), [1.8, 2.2], [1.0, 0.7])
    effects = Effects(gain_spread=0.1)
    simulate(rig, field, GRID, supersample=2, refine=2, effects=effects, seed=2).save(folder)
    return Scan.load(folder)


def test_wernet_learns_what_chords_do_not_know_and_judges_the_held_out_view(unequal):
    settings = {"hold_out": ["cam02"], "fit_gain": False}
    learned = reconstruct(unequal, method="wernet", **settings)
    classic = reconstruct(unequal, **settings)
    report = json.loads(json.dumps(learned.report(), allow_nan=False))
    assert report["method"] == "wernet"
    assert report["settings"]["learned"] is True
    assert set(report["settings"]["held_out_residual"]) == {"chords", "learned"}
    assert list(report["held_out"]) == ["cam02"]
    # views are seen by the learned weights, which hold the cameras' gains
    gains = [
        np.std([view.gain for view in one.views if not view.held_out])
        for one in (learned, classic)
    ]
    assert gains[0] < 0.5 * gains[1]
    assert gains[1] > 0.05
    distances = [one.reconstruction.quality["cosine_distance"] for one in (learned, classic)]
    assert distances[0] < 0.5 * distances[1]
    own = learned.cosine_distances[0]
    assert own[-1] == pytest.approx(distances[0], rel=1e-3)
    assert len(own) == len(learned.reconstruction.history)
    again = reconstruct(unequal, method="wernet", **settings)
    np.testing.assert_array_equal(again.reconstruction.volume, learned.reconstruction.volume)


def test_wernet_of_dark_images_is_empty(copy):
    for path in copy.glob("images/*/*.tif"):
        tifffile.imwrite(path, np.zeros((60, 40), np.float32))
    found = reconstruct(Scan.load(copy), method="wernet", hold_out=["cam02"])
    assert not found.reconstruction.volume.any()
    assert any("the volume is empty" in warning for warning in found.warnings)
    json.dumps(found.report(), allow_nan=False)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"encoder": "x.pt"}, "encoder: found x.pt, expected none for method sirt"),
        ({"freeze_encoder": True}, "freeze_encoder: found True, expected none for method sirt"),
        ({"checkpoint": "x.pt"}, "checkpoint: found x.pt, expected none for method sirt"),
    ],
)
def test_what_only_wernet_takes_is_refused_elsewhere(folder, settings, words):
    with pytest.raises(ValueError, match=words):
        reconstruct(Scan.load(folder), **SIRT, **settings)


def test_another_seed_is_another_start(folder):
    scan, settings = Scan.load(folder).scaled(2), {"method": "wernet-paper", "iterations": 1}
    assert _far(_volume(scan, **settings, seed=1), _volume(scan, **settings, seed=2)) > 1e-3


def test_the_time_limit_stops_the_solver_but_not_before_it_began(folder, outcome):
    found = reconstruct(Scan.load(folder), method="sirt", iterations=10**6, time_limit=0.3)
    assert 0.2 < found.reconstruction.history[-1].seconds < 5
    assert "stopped" in found.reconstruction.stop_reason
    chosen = reconstruct(Scan.load(folder), time_limit=1e-6)
    # choosing takes longer, yet is not what the limit is for
    assert chosen.reconstruction.history[-1].index == 1
    assert chosen.reconstruction.quality["cosine_distance"] < outcome.cosine_distances[0][0] / 2


@pytest.mark.parametrize("method", ["auto", "sirt"])
def test_progress_is_told_all_the_way(folder, method):
    calls = []
    reconstruct(Scan.load(folder), method=method, progress=lambda *call: calls.append(call))
    assert all(0 <= done <= total for done, total, _ in calls)
    where = [place for _, _, place in calls]
    assert where[:7] == [*(f"cam0{n}" for n in range(6)), ""]
    assert any(place.startswith("choosing: ") for place in where) == (method == "auto")
    done, total, name = calls[-1]
    assert done == total
    assert name == ("standard deviations" if method == "auto" else "sirt")


def test_other_ways_in_lead_to_the_same_volume(folder, tmp_path):
    expected = _volume(folder, GRID, **SIRT)
    given = Scan.from_images(folder / "rig.yaml", folder / "images")
    np.testing.assert_array_equal(_volume(given, GRID, **SIRT), expected)
    frames = []
    for camera in load_rig(folder / "rig.yaml"):
        pose = np.eye(4)
        pose[:3, :3] = (np.diag([1, -1, -1]) @ camera.R).T
        pose[:3, 3] = camera.position
        K, (width, height) = camera.camera_matrix, camera.image_size
        frames.append(
            {
                "file_path": f"images/{camera.name}/frame_000.tif",
                "transform_matrix": pose.tolist(),
                **{"w": width, "h": height, "fl_x": K[0, 0], "fl_y": K[1, 1]},
                **{"cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5},
            }
        )
    shutil.copytree(folder / "images", tmp_path / "images")
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    nerf = _volume(Scan.load(tmp_path / "transforms.json"), GRID, **SIRT)
    assert _far(nerf, expected) < 1e-5


def test_the_frame_asked_for_is_the_one_used(copy):
    content = yaml.safe_load((copy / "scan.yaml").read_text())
    bright = {"name": "bright", "images": {}}
    for camera, image in content["frames"][0]["images"].items():
        bright["images"][camera] = image.replace("frame_000", "bright")
        tifffile.imwrite(copy / bright["images"][camera], 3 * tifffile.imread(copy / image))
    content["frames"].append(bright)
    (copy / "scan.yaml").write_text(yaml.safe_dump(content))
    volumes = [_volume(copy, frame=frame, **SIRT) for frame in (None, "frame_000", "bright")]
    np.testing.assert_array_equal(volumes[0], volumes[1])
    np.testing.assert_allclose(volumes[2], 3 * volumes[0], rtol=1e-4, atol=1e-6)


def test_shrunk_images_say_the_same(folder, outcome):
    found = reconstruct(Scan.load(folder).scaled(2))
    assert found.counts["rays"] < 0.4 * outcome.counts["rays"]
    assert found.settings["scale"] == 2
    assert found.reconstruction.quality["cosine_distance"] < 0.025
    assert found.reconstruction.quality["total_ratio"] == pytest.approx(1, abs=0.05)


def test_more_rays_a_pixel(folder):
    found = reconstruct(Scan.load(folder), supersample=2, method="mlem", iterations=10)
    assert found.settings["supersample"] == 2
    assert found.reconstruction.quality["total_ratio"] == pytest.approx(1, abs=0.02)


def test_a_comparison_without_its_iterations_is_told(folder):
    with pytest.raises(ValueError, match="compare: found 'sirt', expected method and iterations"):
        reconstruct(Scan.load(folder), compare=["sirt"])


def test_comparisons_stand_beside_and_change_nothing(folder):
    compare = [("wernet-paper", 1), ("mlem", 3), ("sart", 2)]
    scan = Scan.load(folder).scaled(2)
    found = reconstruct(scan, compare=compare)
    np.testing.assert_array_equal(found.reconstruction.volume, _volume(scan))
    beside = found.report()["comparisons"]
    assert [one["method"] for one in beside] == ["wernet-paper", "mlem", "sart"]
    assert all(np.isfinite(one["quality"]["cosine_distance"]) for one in beside)
    # the curves of two runs of one method are not mixed up
    for course, run in zip(
        results_of(found).history, (found.reconstruction, *found.comparisons), strict=True
    ):
        assert len(course.cosine_distance) == len(run.history)
        own = run.quality["cosine_distance"]
        assert course.cosine_distance[-1] == pytest.approx(own, rel=1e-3)
    assert found.seconds["compare"] > 0


def test_unseen_voxels_are_counted_and_told(folder):
    wide = VoxelGrid((60, 20, 10), 1.0, GRID.center)
    found = reconstruct(Scan.load(folder), wide, margin=np.inf, **SIRT)
    assert 0 < found.counts["active_voxels"] < wide.size
    share = 1 - found.counts["active_voxels"] / wide.size
    assert any(w.startswith(f"{share:.1%} of the voxels are seen by no") for w in found.warnings)


def test_unseen_voxels_are_marked_on_request(folder, tmp_path):
    wide = VoxelGrid((60, 20, 10), 1.0, GRID.center)
    zero = reconstruct(Scan.load(folder), wide, **SIRT)
    marked = reconstruct(Scan.load(folder), wide, unseen="nan", **SIRT)
    unseen = np.isnan(marked.volume)
    live = marked.skipping["live_voxels"]
    assert unseen.sum() == live - marked.counts["active_voxels"] > 0
    np.testing.assert_array_equal(marked.volume[~unseen], zero.volume[~unseen])
    assert not zero.volume[unseen].any()
    write_outcome(tmp_path, marked)
    for name in VOLUME_FILES:
        written, _, _ = read_volume(tmp_path / name, allow_nan=True)
        np.testing.assert_array_equal(np.isnan(written), unseen)
    with pytest.raises(ValueError, match="unseen: found 'none', expected one of zero, nan"):
        reconstruct(Scan.load(folder), unseen="none", **SIRT)


def test_dark_images_give_an_empty_volume_and_a_warning(copy):
    for path in copy.glob("images/*/*.tif"):
        tifffile.imwrite(path, np.zeros((60, 40), np.float32))
    found = reconstruct(Scan.load(copy), hold_out=["cam02"])
    assert not found.reconstruction.volume.any()
    assert any("the volume is empty" in warning for warning in found.warnings)
    json.dumps(found.report(), allow_nan=False)


def test_integer_images_are_judged_over_their_full_scale(copy, outcome):
    for path in copy.glob("images/*/*.tif"):
        pixels = tifffile.imread(path)
        tifffile.imwrite(path, np.round(pixels / 4 * 65535).astype(np.uint16))
    found = reconstruct(Scan.load(copy), hold_out=["cam02"], **SIRT)
    assert found.data_range == 1
    brightest = max(tifffile.imread(p).max() for p in copy.glob("images/*/*.tif")) / 65535
    assert outcome.data_range == pytest.approx(4 * brightest, rel=1e-3)
