"""The study of WERNet's training: are the forms that it times the same training?"""

import numpy as np
import pytest
import torch


@pytest.fixture(scope="module", autouse=True)
def one_thread(on_threads):
    """Tiny arrays are slower on several threads."""
    with on_threads(1):
        yield


@pytest.fixture(scope="module")
def samples(run_tool):
    """Return rays and their pixels without skipping and with it."""
    from _benchmark import training
    from _benchmark.scenes import scene
    from _benchmark.sizes import TINY

    seen = scene("jet", 33, "clean", 1, TINY)
    return {skip: training.samples_of(seen, skip) for skip in (False, True)}


@pytest.fixture(scope="module")
def rows(run_tool):
    from _benchmark import training
    from _benchmark.sizes import TINY

    return training.training(TINY, lambda done, total, where: None)


def test_skipping_keeps_pixels_and_what_they_measured(samples):
    (every, pixels), (lit, lit_pixels) = samples[False], samples[True]
    assert len(np.unique(pixels)) == len(pixels) == len(every)
    place = np.searchsorted(pixels, lit_pixels)
    assert np.array_equal(pixels[place], lit_pixels)
    assert torch.equal(every.measured[place], lit.measured)
    dark = np.delete(every.measured.numpy(), place)
    assert dark.max() < 0.05 < every.measured.max() == 1
    assert bool((lit.count <= every.count[place]).all())


def test_forms_are_timed_on_the_same_rays(rows, samples):
    from _benchmark.training import FORMS, VARIANTS, forms

    assert forms()[:3] == FORMS
    assert [(r["variant"], r["layout"], r["skip"], r["device"]) for r in rows] == [
        (variant, *form) for variant in VARIANTS for form in forms()
    ]
    for row in rows:
        own, _ = samples[row["skip"]]
        assert (row["rays"], row["segments"]) == (len(own), len(own.voxel))
        expected = row["seconds"] * row["rays"] / row["timed_rays"]
        assert row["epoch_seconds"] == pytest.approx(expected)
    padded, packed, skipped = rows[:3]
    assert padded["timed_rays"] == packed["timed_rays"] == 3200
    share = skipped["timed_rays"] / skipped["rays"]
    assert share == pytest.approx(padded["timed_rays"] / padded["rays"], rel=0.05)


def test_gradients_are_compared_once_an_encoder(rows):
    for padded, packed, skipped, *_ in (rows[: len(rows) // 2], rows[len(rows) // 2 :]):
        assert packed["gradient_difference"] < 1e-10
        assert packed["gradient_difference"] < packed["gradient_rounding"] < 1e-2
        assert padded["gradient_difference"] is skipped["gradient_difference"] is None


@pytest.mark.parametrize("variant", ["batch-norm", "bias-mask"])
def test_a_packed_form_that_is_wrong_is_found(samples, monkeypatch, variant):
    from _benchmark import training

    every = training.in_double_precision(samples[False][0])
    rays = torch.arange(0, len(every), 10)
    assert training.gradient_difference(variant, every, rays) < 1e-10

    def without_the_one_before(rows, weight, bias=None):
        weight = weight * torch.tensor([0, 1, 1])
        out = rows @ weight[..., 1].T
        out = out + torch.nn.functional.pad(rows[1:] @ weight[..., 2].T, (0, 0, 0, 1))
        return out if bias is None else out + bias

    monkeypatch.setattr("tomo.wernet.paper.encoder.packed_convolution", without_the_one_before)
    assert training.gradient_difference(variant, every, rays) > 1e-2


def test_claims_are_of_the_skipped_form_and_of_the_gradients(rows):
    from _benchmark.claims import claims

    found = {claim["what"]: claim["value"] for claim in claims({"training": rows})}
    assert len(found) == 4
    times = [value for what, value in found.items() if "time of an epoch" in what]
    assert times == [rows[2]["times_faster"], rows[len(rows) // 2 + 2]["times_faster"]]
    assert rows[2]["times_faster"] == rows[0]["epoch_seconds"] / rows[2]["epoch_seconds"]
