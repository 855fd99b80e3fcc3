import pytest
import torch

from tomo.wernet import Packing

START, COUNT = torch.tensor([7, 0, 3, 20]), torch.tensor([2, 3, 1, 4])


def test_entries_rows_and_empty_rows():
    packing = Packing.of(START, COUNT)
    assert packing.segment.tolist() == [7, 8, 0, 1, 2, 3, 20, 21, 22, 23]
    assert packing.row.tolist() == [1, 2, 4, 5, 6, 8, 10, 11, 12, 13]
    assert packing.mask[:, 0].tolist() == [0, 1, 1, 0, 1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 0]
    assert repr(packing) == "<Packing: 4 rays, 10 segments>"


def test_an_empty_row_stands_before_between_and_behind_all_rays():
    generator = torch.Generator().manual_seed(0)
    count = torch.randint(1, 9, (200,), generator=generator)
    start = torch.randint(0, 1000, (200,), generator=generator)
    packing = Packing.of(start, count)
    inside = packing.mask[:, 0].bool()
    assert int((~inside).sum()) == 201
    runs, length = [], 0
    for one in inside.tolist():
        if one:
            length += 1
        else:
            runs.append(length)
            length = 0
    assert runs[1:] == count.tolist()
    expected = [range(s, s + c) for s, c in zip(start.tolist(), count.tolist(), strict=True)]
    assert packing.segment.tolist() == [entry for ray in expected for entry in ray]


def test_spread_and_take_back():
    packing = Packing.of(START, COUNT)
    values = torch.arange(1.0, 21.0).reshape(10, 2)
    rows = packing.to_rows(values)
    assert torch.equal(rows[packing.row], values)
    assert float(rows.sum()) == float(values.sum())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_sums_and_repeats_are_each_ray_s_own(dtype):
    packing = Packing.of(START, COUNT)
    values = torch.arange(10, dtype=dtype)
    assert packing.sum(values).tolist() == [1, 9, 5, 30]
    assert packing.sum(values).dtype == dtype
    of_ray = torch.tensor([1.0, 2.0, 3.0, 4.0], dtype=dtype)
    assert packing.per_segment(of_ray).tolist() == [1, 1, 2, 2, 2, 3, 4, 4, 4, 4]
    pairs = torch.stack([of_ray, -of_ray], dim=1)
    assert packing.per_segment(pairs).shape == (10, 2)


def test_sum_and_repeat_are_transposes_of_each_other():
    packing = Packing.of(START, COUNT)
    values = torch.randn(10, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    values.requires_grad_()
    assert torch.autograd.gradcheck(packing.sum, values, atol=1e-6)
    of_ray = torch.randn(4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    packing.sum(values).backward(of_ray)
    assert torch.equal(values.grad, packing.per_segment(of_ray))


def test_no_ray_at_all_is_one_empty_row():
    packing = Packing.of(START[:0], COUNT[:0])
    assert packing.mask.tolist() == [[0.0]]
    assert packing.sum(torch.zeros(0)).shape == (0,)
