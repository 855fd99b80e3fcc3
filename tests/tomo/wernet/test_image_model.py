"""The image model in torch: what its gradients are, by the volume and by cameras and gas."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import rigs
from phantoms import GaussianBlobs
from tomo import VoxelGrid
from tomo.model import Absorber, Absorbing, Background, Blur, FallOff, Gain, Pose
from tomo.operators import Absorption
from tomo.wernet import ImageModel, project

GRID = VoxelGrid((11, 13, 11), 1.5)
RIG = rigs.ring(
    2, 120, distance=100.0, image_size=(36, 40), footprint=0.5, pitch_degrees=[12.0, -14.0],
    start_degrees=23.0,
)  # fmt: skip
FLAME = GaussianBlobs([[1.2, -1.4, 0.7], [-1.0, 1.5, -1.0]], [2.3, 2.4], [1.0, 0.7])
VOLUME = torch.as_tensor(FLAME(GRID.centers().reshape(-1, 3)).reshape(GRID.shape))
IMAGES = Gain(), Background(), FallOff()
GAS = Absorbing(own=False), Absorbing(own=True), Absorber(VoxelGrid((1, 1, 1), 18.0))


def model(*effects, **how):
    return ImageModel(RIG, GRID, effects, brightest=4.0, **how)


def few(pixels, count=5):
    """Return some mixtures of all pixels: a gradient takes as long for each number returned."""
    mixtures = torch.randn(count, len(pixels), generator=torch.Generator().manual_seed(3))
    return mixtures.double() @ pixels / len(pixels) ** 0.5


def check(effect, values, step, bound, **how):
    """Compare the gradient with central differences; the bound is a part of the largest."""
    one, name = model(effect, **how), effect.name.replace("-", "_")
    values = torch.tensor(values, dtype=torch.float64, requires_grad=True)

    def shown(given):
        return few(one(VOLUME, **{name: given}))

    largest = float(torch.autograd.functional.jacobian(shown, values).abs().max())
    assert largest > 0.01
    assert torch.autograd.gradcheck(shown, values, eps=step, atol=bound * largest, rtol=0)


@pytest.mark.parametrize(
    ("effect", "values"),
    [(Gain(), [0.3, -0.2]), (Background(), [[0.1], [0.3]]), (FallOff(), 0.25)],
    ids=lambda one: getattr(one, "name", ""),
)
def test_effects_on_images_have_exact_gradients(effect, values):
    check(effect, values, 1e-6, 1e-6)


@pytest.mark.parametrize("basis", ["voxel", "linear"])
@pytest.mark.parametrize("known", [{}, {"absorption": Absorption(medium=0.02)}])
def test_a_field_of_gas_has_exact_gradients(basis, known):
    # Single precision holds lengths: steps of 0.001 leave 1e-4 of their rounding.
    one = model(GAS[2], basis=basis, **known)
    nodes = len(GAS[2].parameters)
    ways = torch.rand(3, nodes, generator=torch.Generator().manual_seed(0)).double() / 10

    def shown(along):
        return few(one(VOLUME, absorber=0.01 + along @ ways))

    along = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(shown, along, eps=1e-3, atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("effect", GAS[:2], ids=["medium", "self-absorption"])
def test_depths_of_gas_have_the_gradients_of_their_columns(effect):
    # A column is the difference by 0.05 of depth, where the exponential bends by 2.5 % of a depth.
    check(effect, 0.3, 1e-3, 0.025)


@pytest.mark.parametrize("basis", ["voxel", "linear"])
def test_poses_have_the_gradients_of_their_columns(basis):
    # Exact chords step where a ray passes an edge of a voxel: differences over half a pixel
    # each way average the steps. Columns are slopes of images blurred by half a pixel, which
    # flattens those of this flame, five pixels wide, by some per cent; voxels three pixels wide
    # show their edges in the voxel basis.
    values = np.random.default_rng(1).normal(0, 0.7, (2, 6))
    check(Pose(), values, 0.5, {"voxel": 0.15, "linear": 0.05}[basis], basis=basis)


def test_a_blur_has_the_gradient_of_its_column():
    check(Blur(), [1.0, 2.0], 0.2, 0.1, basis="linear")


@pytest.mark.parametrize("basis", ["voxel", "linear"])
@pytest.mark.parametrize("gas", [{}, {"medium": 0.3}, {"self_absorption": 0.5}])
def test_the_volume_has_the_exact_gradient_through_all_effects(basis, gas):
    values = {"pose": torch.full((2, 6), 0.4), "gain": torch.tensor([0.2, -0.1]), **gas}
    values |= {"background": torch.tensor([0.1, 0.0]), "fall_off": torch.tensor(0.2)}
    values = {name: torch.as_tensor(one, dtype=torch.float64) for name, one in values.items()}
    one = model(*IMAGES, Pose(), *GAS[:2], basis=basis)
    ways = torch.randn(3, *GRID.shape, generator=torch.Generator().manual_seed(0)).double()
    ways = ways * VOLUME

    def shown(along):
        return few(one(VOLUME + torch.tensordot(along, ways, 1), **values))

    along = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    bound = 1e-3 if gas else 1e-4  # single precision holds what arrives of a segment's light
    assert torch.autograd.gradcheck(shown, along, eps=1e-3, atol=1e-5, rtol=bound)


def test_without_values_pixels_are_the_projection():
    one = model(*IMAGES, Pose())
    torch.testing.assert_close(one(VOLUME), project(VOLUME, one.system), rtol=1e-14, atol=0)
    single = one(VOLUME.float(), gain=torch.zeros(2))
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), one(VOLUME), rtol=0, atol=1e-5)


def test_effects_do_what_their_formulas_say():
    one = model(*IMAGES)
    pixels = one(VOLUME)
    view = np.repeat([0, 1], np.diff(one.system.projector.view_ptr))
    radius = []
    for camera in RIG:
        width, height = camera.image_size
        y, x = np.mgrid[:height, :width]
        square = (x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2
        radius.append(square.ravel() / ((width / 2) ** 2 + (height / 2) ** 2))
    falls = 1 - 0.3 * np.concatenate(radius)[np.concatenate([
        p + v * width * height for v, p in enumerate(one.system.pixels)])]  # fmt: skip
    gain, level = np.array([0.2, -0.1])[view], np.array([0.0, 0.5])[view]
    expected = np.exp(gain) * (falls * pixels.numpy() + level)
    values = {"gain": [0.2, -0.1], "background": [0.0, 0.5], "fall_off": 0.3}
    found = one(VOLUME, **{name: torch.tensor(given) for name, given in values.items()})
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-6)


def test_transforms_of_torch_serve_and_second_derivatives_are_refused():
    one, gains = model(Gain(), Pose()), torch.zeros(2, dtype=torch.float64)

    def loss(values):
        return one(VOLUME, gain=values).square().sum()

    expected = [2 * float(part.square().sum()) for part in one(VOLUME).split(
        np.diff(one.system.projector.view_ptr).tolist())]  # fmt: skip
    assert torch.func.grad(loss)(gains).tolist() == pytest.approx(expected, rel=1e-8)
    gains.requires_grad_()
    (slope,) = torch.autograd.grad(loss(gains), gains, create_graph=True)
    with pytest.raises(NotImplementedError, match="second derivative, expected first ones"):
        slope.sum().backward()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"gain": torch.zeros(3)}, r"gain: found shape \(3,\), expected \(2, 1\) or \(2,\)"),
        ({"pose": torch.zeros(6)}, r"pose: found shape \(6,\), expected \(2, 6\)"),
        ({"medium": torch.zeros(2)}, r"medium: found shape \(2,\), expected \(1,\) or \(\)"),
        ({"gains": torch.zeros(2)}, "gains: found values, expected some of: gain, "),
        ({"gain": torch.tensor([0.0, torch.inf])}, "gain: found 1 NaN or infinite values"),
        ({"medium": torch.tensor(-0.1)}, "medium: found -0.1, expected >= 0"),
        ({"blur": torch.ones(2)}, "blur: found the basis 'voxel', expected 'linear'"),
    ],
)
def test_other_values_are_refused_in_one_line(values, words):
    with pytest.raises(ValueError, match=words) as error:
        model(*IMAGES, Pose(), GAS[0], Blur())(VOLUME, **values)
    assert "\n" not in str(error.value)


def test_other_models_are_refused():
    with pytest.raises(ValueError, match="basis: found 'cubic', expected 'voxel' or 'linear'"):
        model(basis="cubic")
    with pytest.raises(ValueError, match="effects: found gain, gain, expected each name once"):
        model(Gain(), Gain())
    with pytest.raises(ValueError, match="expected one volume"):
        model()(VOLUME[None])


def test_a_camera_and_its_gain_are_found_beside_the_volume():
    rig = rigs.ring(5, distance=100.0, image_size=(22, 24), footprint=0.8, start_degrees=23.0)
    one = ImageModel(rig, GRID, (Gain(), Pose()), basis="linear")
    pose, gain = np.zeros((5, 6)), np.zeros(5)
    pose[2, :2], gain[2] = (1.5, -1.0), 0.1
    measured = one(VOLUME, pose=torch.as_tensor(pose), gain=torch.as_tensor(gain))
    root = torch.full(GRID.shape, 0.3, dtype=torch.float64, requires_grad=True)
    shift, own = (torch.zeros(n, dtype=torch.float64, requires_grad=True) for n in (2, 1))

    def tables():
        camera = torch.nn.functional.pad(shift, (0, 4))
        row = (torch.arange(5) == 2).double()
        return {"pose": row[:, None] * camera, "gain": row * own}

    how = torch.optim.AdamW([{"params": [root]}, {"params": [shift, own], "lr": 0.05}],
                            lr=0.03, weight_decay=0)  # fmt: skip
    for _ in range(120):
        how.zero_grad()
        (one(root.square(), **tables()) - measured).square().mean().backward()
        how.step()
    assert np.abs(shift.detach().numpy() - pose[2, :2]).max() < 0.1
    assert abs(float(own.detach()) - 0.1) < 0.02


def test_a_model_holds_no_state():
    one = model(Gain(), Pose())
    first = one(VOLUME)
    one(2 * VOLUME, pose=torch.ones(2, 6))
    torch.testing.assert_close(one(VOLUME), first, rtol=0, atol=0)
    assert replace(one, effects=()).effects == ()
