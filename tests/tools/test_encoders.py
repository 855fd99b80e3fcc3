"""Training the shipped encoder, and the picture of what is learned: small runs of both."""

import json

import numpy as np
import pytest
import torch

from tomo.wernet import load_encoder


@pytest.fixture(scope="module")
def exercise(run_tool):
    """Return a function that makes small exercises."""
    from _encoders.scenes import random_exercise

    def make(seed, **settings):
        return random_exercise(np.random.default_rng(seed), shape=6, views=3, **settings)

    return make


def misfit(exercise):
    apart = exercise.projector @ exercise.volume - exercise.measured
    return np.linalg.norm(apart) / np.linalg.norm(exercise.measured)


def test_exercises_differ_by_the_pixels_area_alone(exercise):
    grids = set()
    for seed in range(2):
        # the finer the pixels, the truer the chords: nothing else is left out of them
        coarse, fine = exercise(seed, footprint=0.8), exercise(seed, footprint=0.2)
        assert 0.01 < misfit(coarse) < 0.3
        assert misfit(fine) < 0.5 * misfit(coarse)
        grid = coarse.projector.grid
        assert grid == fine.projector.grid
        assert np.prod(grid.spacing) == pytest.approx(1)
        assert max(grid.spacing) > 1.05 * min(grid.spacing)
        grids.add((grid.shape, grid.spacing))
    assert len(grids) == 2


def test_training_repeats_and_looks_at_nothing_but_the_voxel(run_tool, tmp_path):
    arguments = ("--scenes", 2, "--epochs", 3, "--json")
    found = {}
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        path = tmp_path / f"{name}.pt"
        done = run_tool("train_encoders", "-o", path, *arguments, "--seed", seed)
        assert done.exit_code == 0, done.stderr
        told = json.loads(done.stdout)
        assert len(told["misfit"]) == 3
        assert 0.7 < told["misfit"][-1] < 1.3  # of the chords'
        found[name] = load_encoder(path).state_dict()
    for key, value in found["a"].items():
        assert torch.equal(value, found["b"][key])
    assert not torch.equal(found["a"]["last.weight"], found["c"]["last.weight"])
    assert found["a"]["last.weight"].any()
    of_inputs = found["a"]["hidden.0.weight"].abs().sum(dim=(0, 2))
    assert (of_inputs != 0).tolist() == [True] * 6 + [False, True] + [False] * 5


def test_what_to_do_is_asked_for(run_tool, tmp_path):
    for arguments in ((), ("-o", tmp_path / "a.pt", "--judge", "finite-pixels")):
        done = run_tool("train_encoders", *arguments)
        assert done.exit_code == 2
        assert "--out and --judge: expected one of them" in done.stderr


def test_the_picture_of_what_is_learned_asks_for_a_known_effect(run_tool, tmp_path):
    done = run_tool("learned_weights", "-o", tmp_path / "a.png", "--effect", "heat")
    assert done.exit_code == 2
    assert "effect: found 'heat', expected one of gains" in done.stderr
    assert not list(tmp_path.iterdir())


def test_what_is_learned_of_absorption_is_drawn_beside_the_truth(run_tool, tmp_path):
    picture = tmp_path / "learned.png"
    scene = ("--quick", "--effect", "absorption", "--noise", "clean")
    done = run_tool("learned_weights", *scene, "-o", picture, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    found = json.loads(done.stdout)
    assert found["explained"] > 0.999
    assert found["held_out_residual"]["learned"] < 0.7 * found["held_out_residual"]["chords"]
    assert found["cosine_distance"] < 0.005
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_rigs_to_judge_on_are_parts_of_presets_or_lenses_that_bend(run_tool):
    from _encoders.transfer import CASES, rig_of

    import rigs

    whole, some = rigs.preset("paper33_pitch"), rig_of("14 of paper33_pitch")
    assert len(some) == 14
    assert [camera.name for camera in some] == [
        name for name in whole.names if name in set(some.names)
    ]
    assert some.names[0] == whole.names[0]
    coarse, fine = (rig_of(name) for name in ("distorted ring", "fine distorted ring"))
    for one, finer in zip(coarse, fine, strict=True):
        assert one.distortion == finer.distortion
        assert one.distortion.model == "brown"
        np.testing.assert_allclose(finer.camera_matrix[0, 0], 2 * one.camera_matrix[0, 0])
    assert len(set(CASES)) == len(CASES)
