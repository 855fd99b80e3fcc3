"""WERNet where PyTorch has another device: nearly what a CPU gives, and it comes back."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from tomo.metrics import cosine_distance
from tomo.wernet import PaperSettings, load_encoder, save_encoder
from tomo.wernet.default import CorrectionEncoder, RayFeatures, RayWeights, wernet
from tomo.wernet.paper import RaySamples, WeightEncoder, WERNet, wernet_paper

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


@pytest.mark.parametrize("variant", ["no-bias", "bias-mask", "batch-norm"])
def test_the_papers_network_trains_alike(scene, variant):
    one = scene()
    small = PaperSettings(
        inputs="absolute", variant=variant, encoder_learning_rate=0.0005, rays_per_step=400
    )
    here, there = (
        wernet_paper(one.projector, one.measured, iterations=2, settings=small, device=device)
        for device in ("cpu", "cuda")
    )
    assert cosine_distance(here.volume, there.volume) < 1e-4
    assert there.relative_residual == pytest.approx(here.relative_residual, rel=1e-2)
    assert there.settings["device"] == "cuda"


@pytest.mark.parametrize("normalised", [True, False])
@pytest.mark.parametrize(
    ("layout", "dtype", "bound"),
    [
        ("packed", torch.float64, 1e-10),
        ("padded", torch.float64, 1e-10),
        ("packed", torch.float32, 1e-4),  # padded ones are convolved in fewer digits there
    ],
)
def test_gradients_are_alike(scene, layout, dtype, bound, normalised):
    one = scene()
    samples = RaySamples.from_segments(one.projector.segments, one.grid, one.measured)
    kinds = {name: getattr(samples, name).to(dtype) for name in ("midpoint", "index", "measured")}
    samples = replace(samples, **kinds)
    voxels = torch.rand(len(samples.index), generator=torch.Generator().manual_seed(0))
    found = []
    for device in ("cpu", "cuda"):
        model = WERNet(WeightEncoder("batch-norm", seed=1), voxels, normalised)
        model = model.to(device=device, dtype=dtype)
        batch = getattr(samples.to(device), layout)(torch.arange(0, len(samples), 3))
        loss = (model(batch) - batch.measured).square().mean()
        found.append([each.cpu() for each in torch.autograd.grad(loss, list(model.parameters()))])
    for here, there in zip(*found, strict=True):
        assert float((here - there).abs().max()) < bound * float(here.abs().max())


def test_learned_weights_are_alike(scene):
    unweighted = scene().projector
    encoder = CorrectionEncoder(seed=1)
    torch.nn.init.normal_(encoder.last.weight, 0, 0.1, generator=torch.Generator().manual_seed(0))
    volume = np.random.default_rng(2).random(unweighted.shape[1]).astype(np.float32)
    rest = volume, 8.0, RayFeatures.of(unweighted).image_scale, np.ones_like(volume)
    lengths = [
        RayWeights(own, *rest).projector(unweighted).segments.length
        for own in (encoder, copy.deepcopy(encoder).cuda())
    ]
    np.testing.assert_allclose(*lengths, rtol=1e-4, atol=1e-6)


def test_what_chords_do_not_know_is_learned_there(optic):
    one = optic("waves")
    here, there = (
        wernet(one.projector, one.measured, device=device) for device in ("cpu", "cuda")
    )
    assert there.settings["learned"] is True
    assert cosine_distance(here.volume, there.volume) < 1e-3


def test_a_run_is_gone_on_with_there_and_here(scene, tmp_path):
    one = scene(shading=0.4)
    checkpoint = tmp_path / "run.pt"

    def stop(index, volume, residual):
        return index == 1

    for device in ("cuda", "cpu", "cuda"):
        found = wernet(
            one.projector, one.measured, device=device, checkpoint=checkpoint, resume=True,
            callback=None if device == "cpu" else stop,
        )  # fmt: skip
    assert found.settings["learned"] is True
    assert cosine_distance(found.volume, one.truth) < 1e-2


def test_encoders_are_written_and_read_from_there(scene, tmp_path):
    one = scene()
    path = tmp_path / "encoder.pt"
    encoder = wernet_paper(one.projector, one.measured, iterations=1, device="cuda").encoder
    save_encoder(encoder, path)
    again = load_encoder(path, WeightEncoder)
    for written, read in zip(
        encoder.state_dict().values(), again.state_dict().values(), strict=True
    ):
        assert torch.equal(written.cpu(), read)
    for device in ("cpu", "cuda"):
        found = wernet_paper(
            one.projector, one.measured, iterations=1, encoder=path, freeze_encoder=True,
            device=device,
        )  # fmt: skip
        assert np.isfinite(found.volume).all()


def test_a_frozen_encoder_is_used_there(scene):
    one = scene(shading=0.4)
    encoder = CorrectionEncoder(seed=1)
    torch.nn.init.normal_(encoder.last.weight, 0.0, 0.01)
    frozen = {"encoder": encoder, "freeze_encoder": True}
    here, there = (
        wernet(one.projector, one.measured, device=device, **frozen) for device in ("cpu", "cuda")
    )
    assert cosine_distance(here.volume, there.volume) < 1e-5
