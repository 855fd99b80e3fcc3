"""The image of a volume as a module: formulas, gradients, and training loops of one's own."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch.func import functional_call
from torch.nn import functional

from rigs.scene.gas import ExtinctionVolume
from tomo.model import Absorber, FallOff, Observation
from tomo.operators import Absorption
from tomo.wernet import VARIANTS, Encoder, Rays, WERNet


def squared_radius(size):
    """Return the squared distance of each pixel from the image's middle, one in its corners."""
    x, y = (np.arange(n) + 0.5 - n / 2 for n in size)
    return (x**2 + y[:, None] ** 2) / (np.square(size).sum() / 4)


@pytest.fixture(scope="module")
def tiny(scene):
    """Return a scene of four views, its rays and all of them packed."""
    one = scene(views=4, image_size=(7, 10))
    radius = squared_radius((7, 10))
    rays = Rays.of(one.projector, squared_radius=one.system.flatten([radius] * 4))
    return SimpleNamespace(
        scene=one, rays=rays, batch=rays.take(torch.arange(len(rays))),
        views=rays.view.numpy(), measured=torch.from_numpy(one.measured),
    )  # fmt: skip


@pytest.fixture(scope="module")
def volume(tiny):
    """Return random voxels of the tiny scene, (unknowns,) float64."""
    return np.random.default_rng(1).random(tiny.rays.unknowns)


def pixels(batch, *given, **effects):
    """Return the pixels of a model in double precision."""
    with torch.no_grad():
        return WERNet(*given, **effects).double()(batch).numpy()


def everything(unknowns, variant="bias-mask", nodes=None, **options):
    """Return a model in double precision whose every factor is there and not trivial."""
    encoder = Encoder("relative", variant=variant, blocks=2, channels=3, last_bias=0.3, seed=2)
    one = np.ones(2)
    return WERNet(
        np.random.default_rng(3).uniform(0.5, 1, unknowns), encoder, gain=0.1 * one,
        fall_off=0.2 * one, background=0.3 * one,
        absorber=0.1 * np.ones(nodes or np.prod(unknowns)), **options,
    ).double()  # fmt: skip


def gradients(model, batch, loss=lambda found: found.square().sum()):
    """Return the gradient of a loss by each parameter."""
    names, parameters = zip(*model.named_parameters(), strict=True)
    found = torch.autograd.grad(loss(model(batch)), parameters)
    return dict(zip(names, found, strict=True))


def test_without_encoder_and_effects_pixels_are_the_operator_s(tiny, volume):
    expected = tiny.scene.projector @ volume
    np.testing.assert_allclose(pixels(tiny.batch, volume), expected, rtol=1e-12, atol=1e-12)
    some = torch.tensor([200, 3, 77])
    found = pixels(tiny.rays.take(some), volume)
    np.testing.assert_allclose(found, expected[some], rtol=1e-12, atol=1e-12)


def test_gain_fall_off_and_background_are_those_of_tomo_s_model(tiny, volume):
    gain, loss, offset = [0.1, -0.2, 0, 0.3], np.array([0.2, 0.1, 0.3, 0]), [0.5, 0, -1, 2]
    shown = pixels(tiny.batch, volume, gain=gain, fall_off=loss, background=offset)
    bare = (shown - np.take(offset, tiny.views)) / np.exp(gain)[tiny.views]
    images = [image.reshape(10, 7) for image in np.split(bare.astype(np.float32), 4)]
    seen = Observation(tiny.scene.rig, tuple(images), (), (), tiny.scene.grid)
    corrected = FallOff().applied(seen, loss[:, None]).images
    expected = tiny.scene.projector @ volume
    np.testing.assert_allclose(np.ravel(corrected), expected, rtol=1e-5, atol=1e-5)
    assert np.abs(np.ravel(images) - expected).max() > 0.1


@pytest.mark.parametrize("coarse", [True, False])
def test_gas_absorbs_as_in_the_operator_of_a_known_extinction(tiny, volume, coarse):
    one = tiny.scene
    means = Absorber(one.grid).means_in(one.grid) if coarse else None
    nodes = means.shape[1] if coarse else one.grid.size
    k = np.random.default_rng(5).uniform(0, 0.2, nodes)
    extinction = (means @ k if coarse else k).reshape(one.grid.shape)
    gas = Absorption(extinction=ExtinctionVolume(extinction, one.grid.lower, one.grid.spacing))
    expected = one.system.with_absorption(gas).projector @ volume
    found = pixels(tiny.batch, volume, absorber=k, absorber_means=means)
    np.testing.assert_allclose(found, expected, rtol=2e-6)
    assert np.abs(found / (one.projector @ volume) - 1).max() > 0.3


@pytest.mark.parametrize("anchored", [True, False])
@pytest.mark.parametrize("variant", VARIANTS)
def test_gradients_of_every_parameter_together_are_those_of_finite_differences(
    random_rays, variant, anchored
):
    rays = random_rays([5, 3, 1, 4])
    model, batch = everything(7, variant, anchored=anchored), rays.take(torch.arange(4))
    names, parameters = zip(*model.named_parameters(), strict=True)
    assert len(names) == 5 + {"no-bias": 3, "bias-mask": 6, "batch-norm": 8}[variant]

    def image(*values):
        return functional_call(model, dict(zip(names, values, strict=True)), (batch,))

    assert torch.autograd.gradcheck(image, parameters, atol=1e-6, rtol=1e-5)
    assert all(gradient.any() for gradient in gradients(model, batch).values())


def test_a_normalised_gradient_is_the_true_one_over_the_norm_of_the_ray_s_weights(random_rays):
    batch = random_rays([5, 3, 4, 2]).take(torch.arange(4))
    plain, normalised = (
        everything(7, anchored=False, normalise_gradient=on) for on in (False, True)
    )
    torch.testing.assert_close(normalised(batch), plain(batch), rtol=1e-14, atol=0)
    expected = torch.zeros(7, dtype=torch.float64)
    for ray in batch.split([1] * 4):
        depth = 0.1 * ray.length.double()  # of gas
        weights = plain.encode(ray).detach().square() * (depth / 2 - depth.cumsum(0)).exp()
        factor = 2 * plain(ray).detach() * np.exp(0.1) * (1 - 0.2 * ray.squared_radius.double())
        expected.index_add_(0, ray.voxel, factor * weights / weights.norm())
    found, true = (gradients(model, batch) for model in (normalised, plain))
    torch.testing.assert_close(found.pop("voxels"), expected, rtol=1e-12, atol=1e-14)
    for name, gradient in found.items():
        torch.testing.assert_close(gradient, true[name], rtol=1e-12, atol=0)


def padded(model, rays):
    """Return the pixels by PyTorch's convolutions of rays padded to the longest, masked."""
    count = rays.count.tolist()
    batches = [rays.take(torch.tensor([ray])) for ray in range(len(rays))]
    x = torch.zeros(len(rays), 6, max(count), dtype=torch.float64)
    inside = torch.zeros(len(rays), max(count), dtype=torch.bool)
    for ray, one in enumerate(batches):
        x[ray, :, : count[ray]] = one.features[one.row].T
        inside[ray, : count[ray]] = True
    encoder = model.encoder
    for number, layer in enumerate(encoder.hidden):
        x = functional.conv1d(x, layer.weight[:, :, 0], layer.bias, padding=1)
        if encoder.variant == "batch-norm":
            norm = encoder.norms[number]
            rows = functional.batch_norm(
                x.transpose(1, 2)[inside], None, None, norm.weight, norm.bias, training=True
            )
            x = torch.zeros_like(x.transpose(1, 2)).masked_scatter(inside[..., None], rows)
            x = x.transpose(1, 2)
        x = functional.leaky_relu(x, 0.01) * inside[:, None]
    x = functional.conv1d(x, encoder.last.weight[:, :, 0], encoder.last.bias, padding=1)[:, 0]
    image = [
        (x[ray, : count[ray]].square() * model.voxels[one.voxel]).sum()
        for ray, one in enumerate(batches)
    ]
    return torch.stack(image)


@pytest.mark.parametrize("variant", VARIANTS)
def test_packed_rays_are_the_paper_s_padded_ones(random_rays, variant):
    counts = torch.randint(1, 25, (60,), generator=torch.Generator().manual_seed(3)).tolist()
    rays, results = random_rays(counts, unknowns=50), []
    for form in ("packed", "padded"):
        encoder = Encoder("relative", variant=variant, blocks=3, seed=1)
        model = WERNet(np.linspace(0, 1, 50), encoder, anchored=False).double()
        image = model(rays.take(torch.arange(60))) if form == "packed" else padded(model, rays)
        found = torch.autograd.grad(image.square().sum(), list(model.parameters()))
        results.append([image.detach(), *found])
    for packed, expected in zip(*results, strict=True):
        torch.testing.assert_close(packed, expected, rtol=1e-9, atol=1e-12)


def test_gradients_are_the_same_bits_every_time(random_rays, on_threads):
    """Enough rays for several threads: sums in any order would show in nearly every run."""
    batch, found = random_rays([3] * 100_000).take(torch.arange(100_000)), []
    one = np.full(2, 0.1, np.float32)
    start = {"gain": one, "fall_off": one, "background": one, "absorber": np.repeat(one, 5)}
    model = WERNet(torch.ones(10), **start)
    with on_threads(4):
        for _ in range(10):
            found.append(gradients(model, batch))
    for name, first in found[0].items():
        assert all(torch.equal(other[name], first) for other in found[1:]), name


def test_frames_share_the_encoder_and_have_voxels_of_their_own(random_rays):
    rays = random_rays([5, 3, 4])
    both = everything((2, 7), nodes=7)
    both.absorber.data = torch.linspace(0, 0.3, 7, dtype=torch.float64)
    together = both(rays.take(torch.tensor([2, 4, 0, 3])))
    for frame, place, numbers in ((0, [0, 2], [2, 0]), (1, [1, 3], [1, 0])):
        alone = everything(7)
        alone.voxels.data, alone.absorber.data = both.voxels[frame].detach(), both.absorber.data
        found = alone(rays.take(torch.tensor(numbers)))
        torch.testing.assert_close(together[place], found, rtol=1e-12, atol=0)


def test_precisions(tiny):
    encoder = Encoder("relative", seed=1)
    start = np.random.default_rng(1).random(tiny.rays.unknowns, np.float32)
    model = WERNet(start, encoder, gain=np.zeros(4, np.float32))
    expected = model(tiny.batch).detach()
    assert expected.dtype == torch.float32
    with torch.autocast("cpu", dtype=torch.bfloat16):
        coarse = model(tiny.batch)
        gradient = torch.autograd.grad(coarse.sum(), list(model.parameters()))
    assert all(one.isfinite().all() for one in gradient)
    torch.testing.assert_close(coarse.float(), expected, rtol=0.02, atol=0.05)
    fine = model.double()(tiny.batch)
    assert {one.dtype for one in model.parameters()} == {fine.dtype} == {torch.float64}
    torch.testing.assert_close(fine.float(), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["LBFGS", "AdamW"])
def test_loops_of_one_s_own_reach_a_small_residual(tiny, name):
    encoder = Encoder("relative", silent=True)
    model = WERNet(torch.zeros(tiny.rays.unknowns), encoder, background=np.zeros(4, np.float32))
    power = tiny.measured.square().sum()
    if name == "LBFGS":
        optimiser, steps = torch.optim.LBFGS(model.parameters(), line_search_fn="strong_wolfe"), 3
    else:
        optimiser, steps = torch.optim.AdamW(model.parameters(), lr=0.02), 150

    def loss():
        optimiser.zero_grad()
        misfit = (model(tiny.batch) - tiny.measured).square().sum() / power
        misfit.backward()
        return misfit

    for _ in range(steps):
        optimiser.step(loss)
    assert loss().item() ** 0.5 < 0.02


def test_a_frozen_encoder_stays_in_evaluation(tiny):
    encoder = Encoder("relative", variant="batch-norm").requires_grad_(False)
    model = WERNet(torch.ones(tiny.rays.unknowns), encoder)
    model.train()(tiny.batch)
    assert model.training
    assert not encoder.training
    assert not encoder.norms[0].running_mean.any()
    encoder.requires_grad_(True)
    model.train()(tiny.batch)
    assert encoder.norms[0].running_mean.any()


def test_first_values_are_copied_and_numbers_become_floating():
    start = torch.ones(3)
    model = WERNet(start, gain=[1, 2])
    model.voxels.data.zero_()
    assert start.tolist() == [1, 1, 1]
    assert model.gain.dtype == torch.float32
    assert "tensor" not in repr(model)


def test_what_is_missing_is_named(random_rays):
    with pytest.raises(ValueError, match="encoder: found none, expected one"):
        WERNet(torch.ones(7), anchored=False)
    rays = random_rays([3])
    object.__setattr__(rays, "squared_radius", None)
    with pytest.raises(ValueError, match=r"squared_radius: found none, expected it in Rays\.of"):
        WERNet(torch.ones(7), fall_off=np.zeros(2))(rays.take(torch.arange(1)))
