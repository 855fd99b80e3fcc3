import threading

import pytest
import torch

from tomo.wernet.micro_batches import chunk_map, micro_batches, set_summed_gradients

CPU = torch.device("cpu")


@pytest.mark.parametrize(
    "counts",
    [[3] * 17, [1], [100, 1, 1, 100], [0, 0, 5, 0], list(range(40)), [], [0]],
    ids=["even", "one", "long ones", "empty ones", "growing", "none", "one empty"],
)
@pytest.mark.parametrize("segments", [1, 7, 1000])
def test_every_ray_is_in_one_micro_batch(counts, segments):
    parts = micro_batches(torch.tensor(counts, dtype=torch.int64), segments)
    rays = torch.arange(len(counts))
    assert [ray for part in parts for ray in rays[part].tolist()] == rays.tolist()
    assert all(part.stop > part.start for part in parts)


def test_micro_batches_have_about_the_size_asked_for():
    counts = torch.randint(1, 30, (5000,), generator=torch.Generator().manual_seed(0))
    sizes = torch.tensor([int(counts[part].sum()) for part in micro_batches(counts, 1000)])
    assert int(sizes.max()) < 1000 + 30
    assert float(sizes[:-1].float().mean()) == pytest.approx(1000, rel=0.02)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_chunks_run_on_one_thread_each_and_the_number_is_restored(threads, on_threads):
    with on_threads(threads):
        with chunk_map(CPU) as map_chunks:
            found = map_chunks(lambda part: (part, torch.get_num_threads()), list(range(20)))
            assert found == [(part, 1) for part in range(20)]
        assert torch.get_num_threads() == threads


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_an_exception_in_a_chunk_is_raised_and_the_number_restored(threads, on_threads):
    before = threading.active_count()

    def fail(part):
        if part == 3:
            raise ZeroDivisionError("part 3")
        return part

    with on_threads(threads):
        with pytest.raises(ZeroDivisionError, match="part 3"), chunk_map(CPU) as map_chunks:
            map_chunks(fail, list(range(8)))
        with pytest.raises(KeyError, match="in the block"), chunk_map(CPU):
            raise KeyError("in the block itself")
        assert torch.get_num_threads() == threads
    assert threading.active_count() == before


def test_sums_over_chunks_are_the_same_bits_for_any_number_of_threads(on_threads):
    generator = torch.Generator().manual_seed(0)
    rows = torch.randn(60_000, 32, generator=generator)
    weight = torch.randn(32, 32, generator=generator).requires_grad_()
    counts = torch.full((6000,), 10)

    def gradient(part):
        some = rows[part.start * 10 : part.stop * 10]
        return torch.autograd.grad((some @ weight).square().mean(), [weight])

    found = []
    for threads in (1, 2, 4):
        with on_threads(threads), chunk_map(CPU) as map_chunks:
            set_summed_gradients([weight], map_chunks(gradient, micro_batches(counts, 4096)))
        found.append(weight.grad)
    assert all(torch.equal(found[0], other) for other in found[1:])
    assert len(micro_batches(counts, 4096)) > 4


def test_on_other_devices_chunks_follow_one_another():
    with chunk_map(torch.device("meta")) as map_chunks:
        found = map_chunks(lambda part: threading.current_thread().name, [0, 1])
    assert found == [threading.current_thread().name] * 2


def test_gradients_are_added_in_the_order_of_the_chunks():
    parameter = torch.nn.Parameter(torch.zeros(1))
    parts = [[torch.tensor([1e8])], [torch.tensor([1.0])], [torch.tensor([-1e8])]]
    set_summed_gradients([parameter], parts)
    assert parameter.grad.item() == 0.0  # the other order gives 1
    set_summed_gradients([parameter], parts[1:2])
    assert parameter.grad.item() == 1.0  # set, not added to what was there
