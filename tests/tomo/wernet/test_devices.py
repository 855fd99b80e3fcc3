"""WERNet where PyTorch has another device: nearly what a CPU gives, and it comes back."""

import copy

import numpy as np
import pytest
import torch

from tomo.metrics import cosine_distance
from tomo.wernet import (
    VARIANTS,
    Encoder,
    PaperSettings,
    RayFeatures,
    Rays,
    RayWeights,
    WERNet,
    load_encoder,
    save_encoder,
    wernet,
    wernet_paper,
)

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_papers_network_trains_alike(scene, variant):
    one = scene()
    settings = PaperSettings(rays_per_step=400, variant=variant)
    here, there = (
        wernet_paper(one.projector, one.measured, iterations=2, settings=settings, device=device)
        for device in ("cpu", "cuda")
    )
    assert cosine_distance(here.volume, there.volume) < 1e-4
    assert there.relative_residual == pytest.approx(here.relative_residual, rel=1e-2)
    assert there.settings["device"] == "cuda"


@pytest.mark.parametrize("normalised", [True, False])
@pytest.mark.parametrize(("dtype", "bound"), [(torch.float64, 1e-10), (torch.float32, 1e-3)])
def test_pixels_and_gradients_are_alike(scene, dtype, bound, normalised):
    one, found = scene(), []
    start = np.random.default_rng(0).random((2, one.projector.shape[1]))
    effects = {name: np.full(12, 0.1) for name in ("gain", "fall_off", "background")}
    radius = np.linspace(0, 1, one.projector.shape[0])
    for device in ("cpu", "cuda"):
        rays = Rays.of(one.projector, squared_radius=radius, device=device)
        model = WERNet(
            start, Encoder("relative", variant="batch-norm", seed=1), anchored=False,
            absorber=np.full(start.shape[1], 0.02), normalise_gradient=normalised, **effects,
        ).to(device, dtype)  # fmt: skip
        image = model(rays.take(torch.arange(0, 2 * len(rays), 3)))
        gradients = torch.autograd.grad(image.square().mean(), list(model.parameters()))
        found.append([each.detach().cpu() for each in (image, *gradients)])
    for here, there in zip(*found, strict=True):
        assert float((here - there).abs().max()) < bound * float(here.abs().max())


def test_learned_weights_are_alike(scene):
    unweighted = scene().projector
    encoder = Encoder(seed=1)
    torch.nn.init.normal_(encoder.last.weight, 0, 0.1, generator=torch.Generator().manual_seed(0))
    volume = np.random.default_rng(2).random(unweighted.shape[1]).astype(np.float32)
    rest = volume, 8.0, RayFeatures.of(unweighted, "optics").image_scale, np.ones_like(volume)
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
    one, how = scene(), {"checkpoint": tmp_path / "run.pt", "resume": True}
    for iterations, device in ((5, "cuda"), (10, "cpu"), (15, "cuda")):
        found = wernet_paper(
            one.projector, one.measured, iterations=iterations, device=device, **how
        )
        assert len(found.history) == iterations
    assert found.relative_residual < found.history[4].relative_residual


def test_encoders_are_written_and_read_from_there(scene, tmp_path):
    one = scene()
    path = tmp_path / "encoder.pt"
    encoder = wernet_paper(one.projector, one.measured, iterations=1, device="cuda").encoder
    save_encoder(encoder, path)
    again = load_encoder(path)
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
    encoder = Encoder(seed=1)
    torch.nn.init.normal_(encoder.last.weight, 0.0, 0.01)
    frozen = {"encoder": encoder, "freeze_encoder": True}
    here, there = (
        wernet(one.projector, one.measured, device=device, **frozen) for device in ("cpu", "cuda")
    )
    assert cosine_distance(here.volume, there.volume) < 1e-5
