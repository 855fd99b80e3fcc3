"""The published network as a solver."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.metrics import cosine_distance
from tomo.operators import Projector
from tomo.rays import Rays
from tomo.trace import Segments, trace
from tomo.wernet import (
    VARIANTS,
    Encoder,
    PaperSettings,
    TrainingDivergedError,
    load_encoder,
    save_encoder,
    training,
    wernet_paper,
    wernet_paper_frames,
)

GRID = VoxelGrid((10, 12, 10), 0.5, (3.0, -2.0, 1.0))
SMALL_STEPS = {"rays_per_step": 50}


def train(projector, measured, solver=wernet_paper, **options):
    """Train with some options of the solver and some of `PaperSettings`."""
    names = options.keys() & {field.name for field in fields(PaperSettings)}
    settings = PaperSettings(**{name: options.pop(name) for name in names})
    return solver(projector, measured, settings=settings, **options)


@pytest.fixture(scope="module")
def projector():
    """Nine cameras around the box, alternately 15 degrees above and below."""
    target = np.asarray(GRID.center)
    side, height = (np.linspace(-0.5, 0.5, 15) * size for size in (8.0, 6.0))
    origins, points = [], []
    for view in range(9):
        azimuth = 2 * np.pi * view / 9
        pitch = np.radians(15 * (-1) ** view)
        toward = np.array(
            [np.cos(azimuth) * np.cos(pitch), np.sin(pitch), np.sin(azimuth) * np.cos(pitch)]
        )
        right = np.cross(toward, [0, 1, 0]) / np.cos(pitch)
        up = np.cross(right, toward)
        plane = target + side[:, None, None] * right + height[:, None] * up
        points.append(plane.reshape(-1, 3))
        origins.append(np.broadcast_to(target + 200 * toward, points[-1].shape))
    origins, points = np.concatenate(origins), np.concatenate(points)
    rays = Rays.from_lines(origins, points - origins)
    return Projector(trace(rays, GRID, midpoints=True), GRID)


@pytest.fixture(scope="module")
def truth():
    position = (GRID.centers() - GRID.center) / (GRID.extent / 2)
    volume = np.zeros(GRID.shape)
    for height, center, width in (
        (1.0, (0.2, -0.4, 0.0), 0.25),
        (0.7, (-0.3, 0.3, 0.2), 0.3),
        (0.4, (0.0, 0.0, -0.4), 0.2),
    ):
        volume += height * np.exp(-((position - center) ** 2).sum(axis=-1) / (2 * width**2))
    return volume


@pytest.fixture(scope="module")
def measured(projector, truth):
    return projector @ truth.ravel()


@pytest.mark.parametrize("variant", VARIANTS)
def test_training_finds_the_phantom_roughly(projector, measured, truth, variant):
    result = train(projector, measured, iterations=8, variant=variant, **SMALL_STEPS)
    flat = cosine_distance(np.ones(GRID.shape), truth)
    assert cosine_distance(result.volume, truth) < 0.3 * flat
    residuals = [entry.relative_residual for entry in result.history]
    assert residuals[-1] < 0.5 * residuals[0]
    assert [entry.index for entry in result.history] == list(range(1, 9))
    assert result.volume.dtype == np.float32
    assert result.volume.min() >= 0
    assert result.settings["method"] == "wernet-paper"
    # The scale of the volume is the one that fits best.
    projected = projector @ result.volume.ravel().astype(np.float64)
    assert projected @ measured == pytest.approx(projected @ projected, rel=1e-5)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_number_of_threads_changes_no_bit(
    projector, measured, variant, monkeypatch, on_threads
):
    monkeypatch.setattr(training, "CPU_SEGMENTS", 200)  # several parts a step
    found = []
    for threads in (1, 2, 4):
        with on_threads(threads):
            one = train(projector, measured, iterations=1, variant=variant, **SMALL_STEPS)
            assert torch.get_num_threads() == threads
        found.append([one.volume, *(value.numpy() for value in one.encoder.state_dict().values())])
    for other in found[1:]:
        assert all(map(np.array_equal, found[0], other))


def test_parts_of_a_step_are_the_step(projector, measured, monkeypatch):
    whole = train(projector, measured, iterations=1, **SMALL_STEPS)
    monkeypatch.setattr(training, "CPU_SEGMENTS", 100)
    parts = train(projector, measured, iterations=1, **SMALL_STEPS)
    assert np.abs(parts.volume - whole.volume).max() < 2e-3 * whole.volume.max()
    assert not np.array_equal(parts.volume, whole.volume)  # they are two computations


def test_active_voxels_alone_are_trained(projector, measured, truth):
    active = ActiveVoxels.from_mask(GRID, truth > 0.05)
    part = Projector(
        projector.segments.renumbered(active.number), GRID, projector.view_ptr, active
    )
    seen = part @ active.compress(truth)
    volumes = []
    found = train(
        part,
        seen,
        iterations=2,
        callback=lambda index, volume, residual: volumes.append(volume),
        **SMALL_STEPS,
    )
    assert volumes[-1].shape == (active.size,)
    np.testing.assert_array_equal(active.compress(found.volume), volumes[-1])
    assert not found.volume.ravel()[active.number < 0].any()


def test_the_result_scales_with_the_unit_of_the_measurement(projector, measured):
    one = train(projector, measured, iterations=1, **SMALL_STEPS)
    thousand = train(projector, 1024 * measured, iterations=1, **SMALL_STEPS)
    np.testing.assert_array_equal(thousand.volume, 1024 * one.volume)


def test_the_unit_of_length_changes_nothing_but_the_unit(projector, measured, truth):
    def in_other_unit(factor):
        s = projector.segments
        grid = VoxelGrid(GRID.shape, 0.5 * factor, np.multiply(GRID.center, factor))
        length = (s.length * factor).astype(np.float32)
        segments = Segments(s.ptr, s.voxel, length, s.midpoint * np.float32(factor))
        return Projector(segments, grid)

    start = np.random.default_rng(0).random(GRID.shape)
    mm = train(projector, measured, iterations=1, start=start, **SMALL_STEPS)
    m = train(in_other_unit(1 / 1024), measured, iterations=1, start=1024 * start, **SMALL_STEPS)
    np.testing.assert_allclose(
        np.asarray(m.volume), 1024 * np.asarray(mm.volume), rtol=1e-2, atol=10
    )
    assert np.abs(mm.volume).max() > 0.1  # so that the tolerance above is one per cent of it


def test_the_seed_decides_every_bit_and_leaves_the_global_state(projector, measured):
    def run(seed):
        return train(projector, measured, iterations=2, seed=seed, **SMALL_STEPS)

    state = torch.get_rng_state()
    first = run(1)
    assert torch.equal(torch.get_rng_state(), state)
    np.testing.assert_array_equal(first.volume, run(1).volume)
    assert not np.array_equal(first.volume, run(2).volume)


def test_a_frozen_encoder_is_left_as_it_is_and_helps(projector, measured, truth, tmp_path):
    trained = train(projector, measured, iterations=6, blocks=2, **SMALL_STEPS).encoder
    path = tmp_path / "encoder.pt"
    save_encoder(trained, path)
    before = {name: value.clone() for name, value in trained.state_dict().items()}
    arguments = {"iterations": 3, "freeze_encoder": True, **SMALL_STEPS}
    frozen = train(projector, measured, encoder=trained, **arguments)
    for after in (trained.state_dict(), frozen.encoder.state_dict()):
        assert all(torch.equal(before[name], after[name]) for name in before)
    # From a file it is the same encoder, and the file stays as it is.
    from_file = train(projector, measured, encoder=path, **arguments)
    np.testing.assert_array_equal(from_file.volume, frozen.volume)
    assert all(torch.equal(load_encoder(path).state_dict()[name], before[name]) for name in before)
    scratch = train(projector, measured, iterations=3, blocks=2, **SMALL_STEPS)
    assert frozen.relative_residual < scratch.relative_residual
    assert frozen.settings["blocks"] == 2


def test_an_encoder_in_memory_is_copied_and_the_trained_one_returned(projector, measured):
    encoder = Encoder("relative", blocks=1)
    before = encoder.last.weight.clone()
    found = train(projector, measured, iterations=1, encoder=encoder, **SMALL_STEPS)
    assert torch.equal(encoder.last.weight, before)
    assert not torch.equal(found.encoder.last.weight, before)


def test_the_callback_sees_every_epoch_and_stops(projector, measured):
    seen = []

    def callback(index, volume, relative_residual):
        seen.append((index, volume, relative_residual))
        return index == 2

    result = train(projector, measured, iterations=5, callback=callback, **SMALL_STEPS)
    assert [entry[0] for entry in seen] == [1, 2]
    assert seen[1][1].shape == (GRID.size,)
    np.testing.assert_array_equal(seen[1][1].reshape(GRID.shape), result.volume)
    assert seen[1][2] == result.relative_residual
    assert "callback" in result.stop_reason


def test_a_loss_that_is_not_finite_stops_with_a_clear_error(projector, measured):
    with pytest.raises(TrainingDivergedError, match=r"epoch 1: loss.*smaller learning rates"):
        train(projector, measured, voxel_learning_rate=1e30, iterations=2, **SMALL_STEPS)


@pytest.fixture
def diverging(monkeypatch):
    """Let encoders give NaN from the step of this number on: ``diverging.append(number)``."""
    steps, plain = [np.inf], Encoder.forward

    def forward(self, *rows):
        steps[0] -= 1
        return plain(self, *rows) * (1 if steps[0] > 0 else np.nan)

    monkeypatch.setattr(Encoder, "forward", forward)
    return steps


@pytest.mark.parametrize("resume", [False, True])
def test_divergence_after_an_epoch_keeps_the_volume_of_the_epoch_before(
    projector, measured, diverging, tmp_path, resume
):
    volumes, how = [], {"iterations": 9, "checkpoint": tmp_path / "run.pt", **SMALL_STEPS}

    def keep(index, volume, residual):
        volumes.append(volume)
        diverging[0] = 7 if index == 5 else np.inf  # steps of the sixth epoch
        return resume and index == 5

    result = train(projector, measured, callback=keep, **how)
    if resume:
        diverging[0] = 7
        result = train(projector, measured, resume=True, **how)
    assert result.encoder is None
    assert len(result.history) == len(volumes) == 5
    assert result.stop_reason.startswith("diverged in epoch 6; the volume is that of the epoch")
    np.testing.assert_array_equal(result.volume.ravel(), volumes[-1])


def stop_after(number):
    return lambda index, volume, residual: index == number


@pytest.mark.parametrize("variant", ["bias-mask", "batch-norm"])
@pytest.mark.parametrize("after", [3, 5, 8, 12])
def test_a_run_that_was_interrupted_goes_on_to_the_same_bits(
    projector, measured, tmp_path, variant, after
):
    """The state of epoch 3 is none, that of epoch 8 is of epoch 5."""
    path, seen = tmp_path / "run.pt", []
    how = {"iterations": 12, "variant": variant, "blocks": 1, "rays_per_step": 400}
    whole = train(projector, measured, **how)
    train(projector, measured, checkpoint=path, callback=stop_after(after), **how)
    assert path.exists() == (after >= 5)
    how |= {"checkpoint": path, "resume": True}
    found = train(projector, measured, callback=lambda *one: seen.append(one[0]), **how)
    assert seen == list(range(after // 5 * 5 + 1, 13))
    np.testing.assert_array_equal(found.volume, whole.volume)
    assert found.settings == whole.settings
    assert found.stop_reason == whole.stop_reason
    residuals = [[one.relative_residual for one in each.history] for each in (found, whole)]
    assert residuals[0] == residuals[1]
    state = whole.encoder.state_dict()
    assert all(torch.equal(state[name], one) for name, one in found.encoder.state_dict().items())
    assert [each.name for each in tmp_path.iterdir()] == ["run.pt"]


def test_a_training_that_is_done_is_done_and_more_epochs_go_on(projector, measured, tmp_path):
    how = {"checkpoint": tmp_path / "run.pt", "rays_per_step": 400}
    five = train(projector, measured, iterations=5, **how)
    again = train(projector, measured, iterations=5, resume=True, **how)
    np.testing.assert_array_equal(again.volume, five.volume)
    more = train(projector, measured, iterations=7, resume=True, **how)
    whole = train(projector, measured, iterations=7, rays_per_step=400)
    np.testing.assert_array_equal(more.volume, whole.volume)
    anew = train(projector, measured, iterations=1, **how)  # without resume
    assert len(anew.history) == 1


def _other_rays(projector, measured):
    s = projector.segments
    return Projector(Segments(s.ptr, s.voxel[::-1].copy(), s.length, s.midpoint), GRID), measured


OTHERS = {
    "images": (lambda p, m: (p, 1.5 * m), {}),
    "rays": (_other_rays, {}),
    "seed": (lambda *one: one, {"seed": 1}),
    "network": (lambda *one: one, {"blocks": 2}),
}


@pytest.fixture(scope="module")
def state(projector, measured, tmp_path_factory):
    """Return the content of a checkpoint."""
    path = tmp_path_factory.mktemp("state") / "run.pt"
    train(projector, measured, iterations=5, checkpoint=path, blocks=1, rays_per_step=400)
    return path.read_bytes()


@pytest.mark.parametrize("other", OTHERS)
def test_a_checkpoint_of_another_problem_is_refused(projector, measured, state, tmp_path, other):
    path, (change, settings) = tmp_path / "run.pt", OTHERS[other]
    path.write_bytes(state)
    how = {"iterations": 5, "blocks": 1, "rays_per_step": 400, "checkpoint": path, **settings}
    with pytest.raises(ValueError, match=r"run\.pt: problem: found a training of") as caught:
        train(*change(projector, measured), resume=True, **how)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == state


DAMAGE = {
    "voxels of another size": lambda state: state["model"].update(voxels=torch.ones(3)),
    "no optimiser": lambda state: state.pop("optimiser"),
    "history of another type": lambda state: state.update(history=3),
}


@pytest.mark.parametrize("fault", DAMAGE)
def test_a_state_that_does_not_fit_is_refused(projector, measured, state, tmp_path, fault):
    path = tmp_path / "run.pt"
    path.write_bytes(state)
    content = torch.load(path, weights_only=True)
    DAMAGE[fault](content["state"])
    torch.save(content, path)
    how = {"iterations": 5, "blocks": 1, "rays_per_step": 400, "checkpoint": path}
    with pytest.raises(ValueError, match=r"run\.pt: ") as caught:
        train(projector, measured, resume=True, **how)
    assert "\n" not in str(caught.value)


def test_frames_are_trained_with_one_encoder(projector, measured, truth):
    films = np.stack([measured, projector @ truth[::-1].ravel()])
    volumes = []
    both = train(
        projector, films, wernet_paper_frames, iterations=8,
        callback=lambda index, volume, residual: volumes.append(volume), **SMALL_STEPS,
    )  # fmt: skip
    assert both[0].encoder is both[1].encoder
    assert both[0].history == both[1].history
    assert volumes[-1].shape == (2, GRID.size)
    for one, volume, true in zip(both, volumes[-1], (truth, truth[::-1]), strict=True):
        np.testing.assert_array_equal(one.volume.ravel(), volume)
        assert cosine_distance(one.volume, true) < 0.1 * cosine_distance(np.ones(GRID.shape), true)


def test_a_film_of_one_frame_is_that_frame(projector, measured):
    (film,) = train(projector, [measured], wernet_paper_frames, iterations=1, **SMALL_STEPS)
    alone = train(projector, measured, iterations=1, **SMALL_STEPS)
    np.testing.assert_array_equal(film.volume, alone.volume)
    for wrong in (measured, [measured[:-1]]):
        with pytest.raises(ValueError, match=r"measured: found \d+ values, expected 2025 a"):
            train(projector, wrong, wernet_paper_frames)


def test_voxels_that_no_ray_crosses_stay_empty(projector, measured):
    few = projector.rows(0, 225)  # one view
    result = train(few, measured[:225], iterations=1, **SMALL_STEPS)
    unseen = few.column_sums.reshape(GRID.shape) == 0
    assert unseen.any()
    assert not result.volume[unseen].any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"device": "abacus"}, "device: found 'abacus'"),
        ({"device": "meta"}, "device: found 'meta'"),
        ({"iterations": 0}, "iterations: found 0"),
        ({"freeze_encoder": True}, "freeze_encoder"),
        ({"encoder": Encoder("optics")}, "encoder: found one that sees 'optics' inputs, expected"),
        ({"start": np.ones(7)}, r"start: found shape \(7,\), expected a finite volume"),
        (
            {"start": np.full(1200, np.nan)},
            r"start: found shape \(1200,\), expected a finite volume",
        ),
        ({"measured": np.ones(3)}, "measured: found 3 values"),
        ({"measured": np.full(2025, np.inf)}, "measured: found NaN or infinity"),
    ],
)
def test_bad_arguments_are_named_in_one_line(projector, measured, arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        train(projector, **{"measured": measured, **arguments})
    assert "\n" not in str(caught.value)
