import json

import numpy as np
import pytest

from phantoms import create
from rigs import ring
from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.check_options import repeats_of
from tomo.simulation import simulate_images
from tomo.uncertainty import AUTO_REPEATS

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((8, 12, 8), 1.0)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    rig = ring(7, distance=200.0, image_size=(24, 32), footprint=0.5, pitch_degrees=10.0)
    field = create("turbulent", 1, GRID.extent, GRID.center)
    found = simulate_images(rig, field, GRID, supersample=2, refine=2, noise=0.03)
    return load_scan(found.save(tmp_path_factory.mktemp("asked") / "scan"))


def test_only_the_default_method_is_repeated_without_being_asked():
    assert repeats_of(Options()) == AUTO_REPEATS
    assert repeats_of(Options(method="sirt")) == 0
    assert repeats_of(Options(method="sirt", uncertainty=30)) == 30
    assert repeats_of(Options(method="wernet")) == 0


@pytest.mark.parametrize("asked", [1, -3, 2.5, "many"])
def test_what_is_no_number_of_repeats_is_refused(asked):
    with pytest.raises(ValueError, match=r"uncertainty: found .*, expected auto, 0, or 2"):
        Options(uncertainty=asked)


def test_what_is_learned_is_not_repeated():
    with pytest.raises(ValueError, match="uncertainty: found 5 repeats, expected 0 or auto"):
        repeats_of(Options(method="wernet", uncertainty=5))


@pytest.mark.parametrize(("method", "asked"), [("auto", "auto"), ("sirt", 4), ("sirt", "auto")])
def test_the_condition_is_in_the_report(scan, as_given, method, asked):
    options = Options(**as_given | {"method": method, "uncertainty": asked})
    outcome = reconstruct(scan, options=options)
    found = json.loads(json.dumps(outcome.report(), allow_nan=False))["uncertainty"]
    assert found["voxels"]["median_views"] == 7
    assert 0 < found["images"]["noise"] < 2 * found["images"]["residual"]
    repeated = (method, asked) != ("sirt", "auto")
    assert (found["standard_deviation"] is not None) == repeated
    assert (found["resolution"] is not None) == repeated
    if repeated:
        assert found["standard_deviation"]["repeats"] == (4 if asked == 4 else AUTO_REPEATS)
        assert 0.001 < found["standard_deviation"]["relative"] < 0.5
        assert min(found["resolution"]["voxels"]) >= 1


def test_the_condition_changes_nothing_of_the_volume(scan, as_given):
    plain, judged = (
        reconstruct(scan, options=Options(**as_given | {"uncertainty": asked})) for asked in (0, 3)
    )
    assert plain.volume.tobytes() == judged.volume.tobytes()
    assert plain.uncertainty.standard_deviation is None
    assert np.isfinite(judged.uncertainty.standard_deviation).all()
