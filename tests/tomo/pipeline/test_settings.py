"""Tracers, seeds, limits and frames: their effect on the volume."""

import numpy as np
import pytest
import tifffile
import yaml

from tomo import load_scan
from tomo.pipeline import Options, reconstruct

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

SIRT = {"method": "sirt", "iterations": 5}


@pytest.mark.parametrize("tracer", ["raycast", "reference"])
def test_tracers_lead_to_the_same_volume(folder, tracer, volume_of, far, as_given):
    scan = load_scan(folder).scaled(2)  # the reference is slow
    settings = SIRT | as_given
    assert far(volume_of(scan, tracer=tracer, **settings), volume_of(scan, **settings)) < 1e-4


PAPER = {"method": "wernet-paper", "iterations": 1, "seed": 3}
PAPER |= {"screen": False, "refine_cameras": "none"}


@pytest.mark.parametrize("settings", [{}, PAPER])
def test_the_same_again_is_the_same_to_the_bit(folder, settings, volume_of):
    volumes = [volume_of(load_scan(folder).scaled(2), **settings) for _ in range(2)]
    np.testing.assert_array_equal(*volumes)


def test_another_seed_is_another_start(folder, volume_of, far, as_given):
    scan = load_scan(folder).scaled(2)
    settings = as_given | {"method": "wernet-paper", "iterations": 1}
    assert far(volume_of(scan, **settings, seed=1), volume_of(scan, **settings, seed=2)) > 1e-3


def test_the_time_limit_stops_the_solver_but_not_before_it_began(folder, outcome, as_given):
    limited = as_given | {"method": "sirt", "iterations": 10**6, "time_limit": 0.3}
    found = reconstruct(load_scan(folder), options=Options(**limited))
    assert 0.2 < found.solution.history[-1].seconds < 5
    assert "stopped" in found.solution.stop_reason
    chosen = reconstruct(load_scan(folder), options=Options(time_limit=1e-6, **as_given))
    # choosing takes longer, yet is not what the limit is for
    assert chosen.solution.history[-1].index == 1
    assert chosen.solution.quality["cosine_distance"] < outcome.solution.history[0].distance


def test_the_frame_asked_for_is_the_one_used(copy, volume_of, as_given):
    content = yaml.safe_load((copy / "scan.yaml").read_text())
    bright = {"name": "bright", "images": {}}
    for camera, image in content["frames"][0]["images"].items():
        bright["images"][camera] = image.replace("frame_000", "bright")
        tifffile.imwrite(copy / bright["images"][camera], 3 * tifffile.imread(copy / image))
    content["frames"].append(bright)
    (copy / "scan.yaml").write_text(yaml.safe_dump(content))
    volumes = [
        volume_of(copy, frame=frame, **SIRT, **as_given) for frame in (None, "frame_000", "bright")
    ]
    np.testing.assert_array_equal(volumes[0], volumes[1])
    np.testing.assert_allclose(volumes[2], 3 * volumes[0], rtol=1e-4, atol=1e-6)
