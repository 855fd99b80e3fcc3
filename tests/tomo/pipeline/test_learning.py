"""WERNet as a method among others: its learned weights, and the options that it alone takes."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import tifffile

from phantoms import GaussianBlobs, create
from rigs import ring
from tomo import VoxelGrid, load_scan
from tomo.operators import TRANSPARENT
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.infer import effects_of
from tomo.simulation import simulate_images
from tomo.simulation.camera_noise import gaussian
from tomo.simulation.effects import Effects
from tomo.wernet import PaperSettings, load_encoder, load_settings

pytestmark = pytest.mark.usefixtures("quick_choices")


@pytest.fixture(scope="module")
def unequal(tmp_path_factory, grid):
    """Return the scan of ten cameras whose gains differ and are not known."""
    folder = tmp_path_factory.mktemp("unequal") / "scan"
    look = {"image_size": (20, 30), "footprint": 1.0, "pitch_degrees": [10.0, -10.0] * 5}
    rig = ring(10, distance=200.0, center=grid.center, **look)
    field = GaussianBlobs(np.add(grid.center, [[1, 3, -1], [-1, -4, 0.5]]), [1.8, 2.2], [1.0, 0.7])
    effects = Effects(gain_spread=0.1)
    simulate_images(rig, field, grid, supersample=2, refine=2, effects=effects, seed=2).save(
        folder
    )
    return load_scan(folder)


def test_wernet_learns_gains_and_predicts_the_held_out_view(unequal):
    settings = {"hold_out": ["cam02"], "uncertainty": 0}
    # weights alone say what is wrong
    settings |= {"screen": False, "refine_cameras": "none", "fit_absorption": False}
    learned = reconstruct(unequal, options=Options(method="wernet", **settings))
    classic = reconstruct(unequal, options=Options(**settings))
    report = json.loads(json.dumps(learned.report(), allow_nan=False))
    assert report["method"] == "wernet"
    assert report["solver"]["learned"] is True
    assert set(report["solver"]["held_out_residual"]) == {"segment_lengths", "learned"}
    assert list(report["held_out"]) == ["cam02"]
    # views are seen by the learned weights, which hold the cameras' gains
    gains = [
        np.std([view.gain for view in one.views if not view.held_out])
        for one in (learned, classic)
    ]
    assert gains[0] < 0.5 * gains[1]
    assert gains[1] > 0.05
    distances = [one.solution.quality["cosine_distance"] for one in (learned, classic)]
    assert distances[0] < 0.75 * distances[1]
    own = [entry.distance for entry in learned.solution.history]
    assert own[-1] == pytest.approx(distances[0], rel=1e-3)
    assert None not in own


def test_what_is_refused_is_not_learned_either(unequal, as_given):
    """Without gains to learn, the volume is the default's to the bit."""
    learned, classic = (
        reconstruct(unequal, method=name, **as_given) for name in ("wernet", "auto")
    )
    assert learned.report()["solver"]["learned"] is False
    np.testing.assert_array_equal(learned.volume, classic.volume)


@pytest.mark.parametrize(
    ("off", "refused"),
    [
        ({}, ()),
        ({"fit_gain": False}, ("gain",)),
        ({"fit_absorption": False}, ("absorption",)),
        ({"absorption": 0.01}, ("absorption",)),
        ({"refine_cameras": "none"}, ()),
        ({"screen": False}, ()),
        ({"blur": 1.0}, ()),
        ({"fit_gain": False, "fit_absorption": False}, ("gain", "absorption")),
    ],
)
def test_wernet_hears_the_same_physics_as_the_default(grid, off, refused):
    auto, own = (Options(method=name, **off) for name in ("auto", "wernet"))
    heard = [effects_of(one, TRANSPARENT, grid, 1, 16) for one in (auto, own)]
    assert heard[0] == heard[1]
    assert own.refused == refused


def test_before_it_learns_wernet_is_the_default(unequal):
    gains = {"screen": False, "refine_cameras": "none", "fit_gain": True, "uncertainty": 0}
    gains |= {"fit_absorption": False}
    own = reconstruct(unequal, method="wernet", iterations=0, **gains)
    default = reconstruct(unequal, **gains)
    assert default.gains is not None
    np.testing.assert_array_equal(own.volume, default.volume)


@pytest.mark.parametrize(
    ("effects", "better", "shape", "image_size"),
    [
        (Effects(gain_spread=0.1), -0.2, (16, 26, 16), (40, 60)),
        (Effects(absorption=0.063), 0.2, (24, 38, 24), (60, 88)),
    ],
    ids=["gains", "absorption"],
)
def test_few_views_teach_shared_effects_and_not_their_own(
    tmp_path, monkeypatch, as_given, effects, better, shape, image_size
):
    grid = VoxelGrid(shape, 1.0)
    look = {"image_size": image_size, "footprint": 0.5, "pitch_degrees": 10.0}
    rig = ring(5, distance=300.0, center=grid.center, start_degrees=5.0, **look)
    flame = create("turbulent", 13, grid.extent, grid.center)
    made = simulate_images(rig, flame, grid, supersample=2, refine=2, effects=effects, seed=13)
    images = gaussian(list(made.images.values()), 0.005, np.random.default_rng(13))
    made = replace(made, images=dict(zip(rig.names, images, strict=True)))
    scan = load_scan(made.save(tmp_path / "scan"))
    monkeypatch.setattr(Options, "refused", ())  # the encoder alone may learn what is off
    settings = as_given | {"hold_out": ["cam02"]}
    learned, classic = (
        reconstruct(scan, options=Options(method=method, **settings)).report()["held_out"][
            "cam02"
        ]["psnr"]
        for method in ("wernet", "auto")
    )
    assert learned > classic + better


def test_wernet_of_dark_images_is_empty(copy):
    for path in copy.glob("images/*/*.tif"):
        tifffile.imwrite(path, np.zeros_like(tifffile.imread(path)))
    found = reconstruct(load_scan(copy), options=Options(method="wernet", hold_out=["cam02"]))
    assert not found.solution.volume.any()
    assert any("the volume is empty" in warning for warning in found.warnings)
    json.dumps(found.report(), allow_nan=False)


def test_settings_of_wernet_are_refused_elsewhere(folder):
    words = "wernet_settings: found paper, expected none for method sirt: only wernet and wernet-"
    with pytest.raises(ValueError, match=words):
        reconstruct(load_scan(folder), method="sirt", wernet_settings="paper")


@pytest.mark.parametrize("given", ["paper-text", "own.yaml"])
def test_the_paper_s_method_takes_its_settings_from_a_file(
    folder, tmp_path, monkeypatch, as_given, given
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text("channels: 4\nloss: absolute\n")
    options = Options(method="wernet-paper", iterations=1, wernet_settings=given, **as_given)
    found = reconstruct(load_scan(folder).scaled(2), options=options)
    asked = asdict(load_settings(given, PaperSettings))
    assert asked != asdict(PaperSettings())
    assert {name: found.report()["solver"][name] for name in asked} == asked


def test_wernet_takes_its_settings_from_a_file_before_images_are_read(folder, tmp_path, as_given):
    path = tmp_path / "own.yaml"
    path.write_text("channels: 4\nblocks: 1\n")
    options = as_given | {"method": "wernet", "iterations": 0, "wernet_settings": path}
    found = reconstruct(load_scan(folder).scaled(2), options=Options(**options))
    assert (found.report()["solver"]["blocks"], found.report()["solver"]["channels"]) == (1, 4)
    path.write_text("variant: batch-norm\n")
    with pytest.raises(ValueError, match=r"own\.yaml: 'variant': found a field that Wernet"):
        reconstruct(load_scan(folder).without("cam00"), options=Options(**options))


def test_the_trained_encoder_is_saved_on_request(folder, tmp_path, as_given):
    path = tmp_path / "encoder.pt"
    scan = load_scan(folder).scaled(2)
    settings = as_given | {"method": "wernet-paper", "iterations": 1}
    how = tmp_path / "how.yaml"
    how.write_text("save_encoder: encoder.pt\n")
    reconstruct(scan, options=Options(**settings, wernet_settings=how))
    assert load_encoder(path).settings.items() >= {"inputs": "relative", "channels": 32}.items()
    untrained = tmp_path / "none.pt"
    how.write_text("save_encoder: none.pt\n")
    settings |= {"method": "wernet", "iterations": 0}
    found = reconstruct(scan, options=Options(**settings, wernet_settings=how))
    assert not untrained.exists()
    assert any("no encoder was trained" in warning for warning in found.warnings)
