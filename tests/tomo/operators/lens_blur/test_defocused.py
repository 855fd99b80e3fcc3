import numpy as np
import pytest
import scipy.sparse

from tomo import LinearSystem
from tomo.operators import Defocused, dot_test


@pytest.fixture(scope="module")
def spread(lines):
    """Each view's own shares, about a dozen a pixel, none the same."""
    random = np.random.default_rng(1)
    parts = [
        scipy.sparse.random_array((n, n), density=12 / max(n, 1), rng=random, format="csr")
        for n in np.diff(lines.view_ptr)
        if n
    ]
    return scipy.sparse.csr_array(
        scipy.sparse.block_diag(parts, format="csr", dtype=np.float32)
        + scipy.sparse.eye_array(400, dtype=np.float32)
    )


@pytest.fixture(scope="module")
def defocused(lines, spread):
    return Defocused(lines, spread)


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
@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])
def test_the_adjoint_matches(defocused, name, dtype, bound):
    part, _ = some_of(defocused)[name]
    assert max(dot_test(part, seed, dtype) for seed in range(20)) < bound


@PARTS
def test_a_part_is_the_product_of_both_matrices_rows(defocused, lines, spread, name):
    part, pixels = some_of(defocused)[name]
    expected = (spread.astype(np.float64) @ lines.to_scipy().astype(np.float64))[pixels]
    x = np.random.default_rng(2).standard_normal(lines.shape[1])
    y = np.random.default_rng(3).standard_normal(len(pixels))
    assert part.shape == (len(pixels), lines.shape[1])
    np.testing.assert_allclose(part @ x, expected @ x, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(part.T @ y, expected.T @ y, rtol=1e-11, atol=1e-12)


def test_parts_keep_their_views(defocused):
    assert defocused.n_views == 4
    assert defocused.subset([3, 0]).view_ptr.tolist() == [0, 150, 250]
    assert defocused.take(np.arange(0, 400, 50)).view_ptr.tolist() == [0, 2, 2, 5, 8]


def test_other_weights_are_spread_as_the_chords_are(defocused, lines, spread):
    length = np.random.default_rng(4).standard_normal(len(lines.segments)).astype(np.float32)
    x = np.random.default_rng(5).random(lines.shape[1])
    found = defocused.with_lengths(length) @ x
    np.testing.assert_allclose(found, spread @ (lines.with_lengths(length) @ x), rtol=1e-6)
    assert np.array_equal(defocused.segments.length, lines.segments.length)


def test_the_bits_do_not_depend_on_the_threads(defocused, on_threads):
    x = np.random.default_rng(6).random(defocused.shape[1]).astype(np.float32)
    y = np.random.default_rng(7).random(400).astype(np.float32)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            found.append(((defocused @ x).tobytes(), (defocused.T @ y).tobytes()))
    assert found[0] == found[1]


def test_a_spread_of_other_lines_is_refused(lines, spread):
    with pytest.raises(ValueError, match="spread: found one of 300 lines, expected 400"):
        Defocused(lines, spread[:, :300])


def test_repr_names_the_lines(defocused):
    assert repr(defocused).startswith("<Defocused: 400 pixels of <Projector: 4 views")


def test_lines_found_anew_at_every_product_are_spread_alike(out_of_focus):
    """A matrix that is stored and one that is not give the same images and volumes."""
    rig, grid = out_of_focus.rig, out_of_focus.grid
    both = [LinearSystem.from_rig(rig, grid, form=form) for form in ("stored", "on-the-fly")]
    stored, followed = (system.out_of_focus(1.0) for system in both)
    x = np.random.default_rng(8).random(grid.size).astype(np.float32)
    for a, b in zip(
        stored.images(stored.projector @ x), followed.images(followed.projector @ x), strict=True
    ):
        np.testing.assert_allclose(a, b, atol=1e-4 * a.max())


def test_the_images_of_a_lens_are_near(out_of_focus):
    """Rays through all of a lens, through finer voxels, agree with the lines once spread.

    What is left is what voxels of half the disc's width miss of edges.
    """
    one = out_of_focus
    measured = one.system.flatten(one.images)
    truth = one.truth.ravel()
    apart = [
        np.linalg.norm(system.projector @ truth - measured) / np.linalg.norm(measured)
        for system in (one.system, one.system.out_of_focus(one.blur))
    ]
    assert apart[1] < 0.2 * apart[0]
