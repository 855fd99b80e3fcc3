"""Steps in parts that suit the device, and epochs of voxels and encoder."""

import threading

import numpy as np
import pytest
import torch

from tomo.wernet import Encoder, PaperSettings, WERNet, training, usable_device
from tomo.wernet.training import JointTraining, part_map, parts_of

CPU = torch.device("cpu")


@pytest.mark.parametrize(
    "counts",
    [[3] * 17, [1], [100, 1, 1, 100], [0, 0, 5, 0], list(range(40)), [], [0]],
    ids=["even", "one", "long ones", "empty ones", "growing", "none", "one empty"],
)
@pytest.mark.parametrize("segments", [1, 7, 1000])
def test_every_ray_is_in_one_part(random_rays, monkeypatch, counts, segments):
    monkeypatch.setattr(training, "CPU_SEGMENTS", segments)
    batch = random_rays(counts).take(torch.arange(len(counts)))
    parts = list(parts_of(batch))
    assert [ray for part in parts for ray in part.number.tolist()] == batch.number.tolist()
    assert all(len(part) for part in parts)


def test_parts_have_about_the_size_asked_for(random_rays, monkeypatch):
    monkeypatch.setattr(training, "CPU_SEGMENTS", 1000)
    counts = torch.randint(1, 30, (5000,), generator=torch.Generator().manual_seed(0)).tolist()
    sizes = [len(part.voxel) for part in parts_of(random_rays(counts).take(torch.arange(5000)))]
    assert max(sizes) < 1000 + 30
    assert np.mean(sizes[:-1]) == pytest.approx(1000, rel=0.02)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_parts_run_on_one_thread_each_and_the_number_is_restored(threads, on_threads):
    with on_threads(threads):
        with part_map(CPU) as map_parts:
            found = map_parts(lambda part: (part, torch.get_num_threads()), range(20))
            assert found == [(part, 1) for part in range(20)]
            assert torch.get_num_threads() == 1  # between two steps as well
        assert torch.get_num_threads() == threads


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_an_exception_in_a_part_is_raised_and_the_number_restored(threads, on_threads):
    before = threading.active_count()

    def fail(part):
        if part == 3:
            raise ZeroDivisionError("part 3")
        return part

    with on_threads(threads):
        with pytest.raises(ZeroDivisionError, match="part 3"), part_map(CPU) as map_parts:
            map_parts(fail, range(8))
        with pytest.raises(KeyError, match="in the block"), part_map(CPU):
            raise KeyError("in the block itself")
        assert torch.get_num_threads() == threads
    assert threading.active_count() == before


@pytest.mark.parametrize("device", ["abacus", "meta", "cuda:99"])
def test_a_device_that_is_not_there_is_named_in_one_line(device):
    with pytest.raises(ValueError, match=f"device: found '{device}', expected one") as caught:
        usable_device(device)
    assert "\n" not in str(caught.value)
    assert usable_device("cpu") == CPU


@pytest.fixture
def joint(random_rays):
    """Return a function that makes a training of 103 rays, two of them empty, and two frames."""

    def make(encoder=None, frames=2, **settings):
        rays = random_rays([3, 0, *range(1, 51), 0, *range(1, 51)], unknowns=20)
        own = encoder or Encoder("relative", blocks=1, channels=4, last_bias=0.5)
        model = WERNet(torch.full((frames, 20), 0.1), own, anchored=False)
        measured = np.random.default_rng(0).random((frames, len(rays)))
        chosen = PaperSettings(rays_per_step=25, **settings)
        order = torch.Generator().manual_seed(0)
        return JointTraining(model, own, rays, measured, chosen, True, order)

    return make


@pytest.mark.parametrize("variant", ["bias-mask", "batch-norm"])
def test_an_epoch_uses_every_ray_that_crosses_of_every_frame_once(joint, monkeypatch, variant):
    monkeypatch.setattr(training, "CPU_SEGMENTS", 200)
    own, seen = joint(Encoder("relative", variant=variant, blocks=1)), []
    plain = own.model.forward
    monkeypatch.setattr(own.model, "forward", lambda part: (seen.append(part), plain(part))[1])
    own.run(2, 0.0, lambda history: False)
    numbers = torch.cat([part.number for part in seen])
    expected = [
        frame * 103 + ray for frame in range(2) for ray in range(103) if ray not in (1, 52)
    ]
    first, second = numbers.split(len(expected))
    assert first.sort().values.tolist() == second.sort().values.tolist() == expected
    assert not torch.equal(first, second)
    sizes = [len(part) for part in seen]
    if variant == "batch-norm":  # the statistics are those of the step
        assert sizes == 2 * ([25] * 8 + [2])
    else:
        assert max(len(part.voxel) for part in seen) < 250


@pytest.mark.parametrize("loss", ["squared", "absolute"])
def test_a_step_goes_down_the_mean_loss_of_its_rays(joint, monkeypatch, loss):
    monkeypatch.setattr(training, "CPU_SEGMENTS", 200)
    own = joint(loss=loss)
    optimiser = torch.optim.SGD(own.model.parameters(), lr=1e-3)
    own.optimiser, before = optimiser, [one.detach().clone() for one in own.model.parameters()]
    numbers = own.numbers[:25]
    batch = own.rays.take(numbers)
    error = own.model(batch) - own.measured[numbers]
    mean = error.square().mean() if loss == "squared" else error.abs().mean()
    slopes = torch.autograd.grad(mean, list(own.model.parameters()))
    with part_map(CPU) as map_parts:
        squares = own.use(numbers, map_parts)
    assert squares == pytest.approx(error.square().sum().item(), rel=1e-5)
    for parameter, old, slope in zip(own.model.parameters(), before, slopes, strict=True):
        torch.testing.assert_close(parameter.detach(), old - 1e-3 * slope)


@pytest.mark.parametrize("frozen", [True, False])
def test_rates_are_halved_and_frozen_encoders_stay(joint, frozen):
    encoder = Encoder("relative", variant="batch-norm", blocks=1).requires_grad_(not frozen)
    own = joint(encoder, halve_every=2, voxel_learning_rate=0.04, encoder_learning_rate=0.02)
    before = {name: value.clone() for name, value in encoder.state_dict().items()}
    own.run(5, 0.0, lambda history: False)
    rates = [group["lr"] for group in own.optimiser.param_groups]
    assert rates == [0.01] if frozen else rates == [0.01, 0.005]
    same = [torch.equal(before[name], value) for name, value in encoder.state_dict().items()]
    assert all(same) if frozen else not any(same)
