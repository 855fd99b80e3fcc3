import numpy as np
import pytest

import rigs
from tomo import LinearSystem
from tomo.operators import ImageBlur

VIEWS = (np.arange(100), np.arange(0), np.arange(3, 453, 3), np.arange(150))
"""The pixels of images of 20 x 30 that take part: 100, none, 150 with gaps, 150."""


@pytest.fixture(scope="module")
def images():
    """Other random weights for each view, and a part of the light that stays where it is."""
    random = np.random.default_rng(1)
    kernels = []
    for _ in VIEWS:
        place = random.choice(49, size=12, replace=False)
        offsets = np.stack(np.divmod(place, 7), axis=1) - 3
        kernels.append((offsets, random.random(12).astype(np.float32)))
    rig = rigs.ring(4, distance=100.0, image_size=(20, 30), footprint=1.0)
    seen = random.random(400) > 0.1
    return ImageBlur.from_kernels(rig, VIEWS, kernels, seen=seen, keeps_light=True)


@pytest.fixture(scope="module")
def kernel(images, matrix_of):
    return matrix_of(images)


@pytest.fixture(scope="module")
def blurred(lines, images):
    return images @ lines


def test_the_matrix_has_each_weight_at_the_pixel_that_its_kernel_says(images, kernel):
    pixel = 250 + 20 * 4 + 9  # of the last view: row 4, column 9
    offsets, weights = images.kernels[3]
    expected = np.zeros(400)
    for (right, down), weight in zip(offsets, weights, strict=True):
        row, column = 4 + down, 9 + right
        if row >= 0 and 0 <= column < 20 and 20 * row + column < 150:
            expected[250 + 20 * row + column] += weight
    expected *= images.rays.seen
    expected[pixel] += 1 - expected.sum()
    found = kernel[[pixel]].toarray().ravel()
    np.testing.assert_allclose(found, expected * images.pixels.seen[pixel], atol=1e-6)


def test_light_is_kept_where_that_is_asked_for_and_nothing_else_is_seen(images, kernel):
    np.testing.assert_allclose(kernel.sum(axis=1), images.pixels.seen, atol=1e-6)
    assert not kernel[:, ~images.rays.seen].nnz


def some_of(operator):
    return {
        "whole": (operator, np.arange(400)),
        "subset": (operator.subset([3, 0]), np.r_[250:400, 0:100]),
        "take": (operator.take(np.arange(0, 400, 3)), np.arange(0, 400, 3)),
        "view": (operator.view(2), np.arange(100, 250)),
        "none": (operator.view(1), np.arange(0)),
    }


PARTS = pytest.mark.parametrize("name", ["whole", "subset", "take", "view", "none"])


@PARTS
def test_a_part_is_the_product_of_both_matrices_rows(blurred, lines, kernel, name):
    part, pixels = some_of(blurred)[name]
    expected = (kernel.astype(np.float64) @ lines.to_scipy().astype(np.float64))[pixels]
    x = np.random.default_rng(2).standard_normal(lines.shape[1])
    y = np.random.default_rng(3).standard_normal(len(pixels))
    assert part.shape == (len(pixels), lines.shape[1])
    np.testing.assert_allclose(part @ x, expected @ x, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(part.T @ y, expected.T @ y, rtol=1e-11, atol=1e-12)


def test_parts_keep_their_views(blurred):
    assert blurred.n_views == 4
    assert blurred.subset([3, 0]).view_ptr.tolist() == [0, 150, 250]
    assert blurred.take(np.arange(0, 400, 50)).view_ptr.tolist() == [0, 2, 2, 5, 8]


def test_other_lengths_are_blurred_as_the_segment_lengths_are(blurred, lines, kernel):
    length = np.random.default_rng(4).standard_normal(len(lines.segments)).astype(np.float32)
    x = np.random.default_rng(5).random(lines.shape[1])
    found = blurred.with_lengths(length) @ x
    np.testing.assert_allclose(found, kernel @ (lines.with_lengths(length) @ x), rtol=1e-6)
    assert np.array_equal(blurred.segments.length, lines.segments.length)


def test_the_bits_do_not_depend_on_the_threads(blurred, on_threads):
    x = np.random.default_rng(6).random(blurred.shape[1]).astype(np.float32)
    y = np.random.default_rng(7).random(400).astype(np.float32)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            found.append(((blurred @ x).tobytes(), (blurred.T @ y).tobytes()))
    assert found[0] == found[1]


def test_images_of_other_rays_are_refused(lines, images):
    with pytest.raises(
        ValueError, match="image operator: found one of 300 pixels, expected the 400 of the rays"
    ):
        ImageBlur(images.kernels, images.pixels, images.rays.take(np.arange(300))) @ lines


def test_rays_on_the_fly_are_blurred_alike(cameras):
    """A matrix that is stored and one that is not give the same images and volumes."""
    rig, grid = cameras.rig, cameras.grid
    both = [LinearSystem.from_rig(rig, grid, form=form) for form in ("stored", "on-the-fly")]
    stored, followed = (system.with_lens_blur(1.0) for system in both)
    x = np.random.default_rng(8).random(grid.size).astype(np.float32)
    for a, b in zip(
        stored.images(stored.projector @ x), followed.images(followed.projector @ x), strict=True
    ):
        np.testing.assert_allclose(a, b, atol=1e-4 * a.max())
