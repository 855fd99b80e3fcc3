"""The gains of a result are those that its images were corrected by, from whatever stage."""

import sys

import numpy as np
import pytest

from phantoms import GaussianBlobs
from rigs import ring
from tomo import Scan, VoxelGrid
from tomo.pipeline import Options, reconstruct
from tomo.report.facts import detail_tables
from tomo.simulation import simulate_images

GRID = VoxelGrid((14, 20, 14), 1.0, (1.0, -2.0, 0.5))
RIG = ring(
    10, distance=200.0, image_size=(24, 30), footprint=1.0, center=GRID.center,
    pitch_degrees=[18.0, -12.0] * 5,
)  # fmt: skip
FIELD = GaussianBlobs(
    GRID.center + np.array([[-2.2, -3, 0.5], [1.8, 0, -1.4], [-0.5, 4, 1.2]]),
    [1.5, 1.7, 1.4],
    [1.0, 0.8, 0.6],
)
TRUE = np.array([1.03, 0.98, 1.0, 1.5, 0.97, 1.02, 1.04, 0.99, 0.95, 1.01])
QUICK = {"uncertainty": 0, "fit_absorption": False, "refine_cameras": "none"}


@pytest.fixture(scope="module")
def scan():
    """Return images of cameras of known gains, one of which stands out."""
    made = simulate_images(RIG, FIELD, GRID, supersample=4, refine=2)
    random, top = np.random.default_rng(3), max(image.max() for image in made.images.values())
    images = {
        name: gain * image / top + random.normal(0, 0.003, image.shape)
        for gain, (name, image) in zip(TRUE, made.images.items(), strict=True)
    }
    return Scan.from_arrays(RIG, images, GRID)


@pytest.fixture(scope="module")
def stages_and_result(scan, choose_quickly, solve_quickly):
    kept = []

    def assemble(stages, *args, **how):
        kept.append(stages)
        return given(stages, *args, **how)

    module = sys.modules["tomo.pipeline.reconstruct"]  # the package has a function of this name
    given = module.assemble
    with pytest.MonkeyPatch.context() as patch, choose_quickly(), solve_quickly():
        patch.setattr(module, "assemble", assemble)
        result = reconstruct(scan, options=Options(**QUICK))
    return kept[0], result


def test_they_are_all_that_was_applied(stages_and_result):
    stages, result = stages_and_result
    built, system = stages.ready.built, stages.ready.built.system
    gain, offset = (
        np.repeat(list(result.gains[key].values()), np.diff(system.projector.view_ptr))
        for key in ("gain", "offset")
    )
    recorded = system.flatten(stages.load.images)
    used = system.flatten([mask.astype(np.float32) for mask in stages.ready.screened.masks]) > 0
    corrected = (recorded - offset) / gain
    np.testing.assert_allclose(corrected[used], built.measured[used], atol=1e-5)


@pytest.mark.xfail(
    strict=True,
    reason="gains of 3 to 5 % among ten cameras: one stays, 2.6 % off; 0.6 % were reached before "
    "the inference, by the total light of views",
)
def test_they_are_the_cameras_own(stages_and_result):
    gains = stages_and_result[1].gains
    relative = np.array(list(gains["gain"].values())) / TRUE
    relative /= np.exp(np.log(relative).mean())
    assert np.abs(relative - 1).max() < 0.02
    assert max(gains["gain_error"].values()) < 0.01


def test_reports_have_them_with_their_errors(stages_and_result):
    result = stages_and_result[1]
    report = result.report()
    assert report["gains"]["gain"] == dict(result.gains["gain"])
    lines = dict(dict(detail_tables(report))["Gains and backgrounds"])
    assert list(lines) == list(RIG.names)
    assert lines["cam03"].startswith(f"gain {result.gains['gain']['cam03']:.4g} ± 0.00")
    (finding,) = [one for one in report["findings"] if one["camera"] == "cam03"]
    assert f"'cam03': {1 / result.gains['gain']['cam03']:.3g}" in finding["line"]
    assert finding["effect"] == "gain"
    assert finding["size"] == pytest.approx(result.gains["gain"]["cam03"] - 1)
