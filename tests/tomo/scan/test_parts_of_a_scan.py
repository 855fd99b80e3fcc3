"""A scan shrunk, or of some of its cameras."""

import numpy as np
import pytest

from rigs.recordings import write_image
from tomo import load_scan


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_area_means_keep_the_mean_and_what_each_pixel_sees(folder, factor, rig, frames):
    scan = load_scan(folder)
    small = scan.scaled(factor)
    for big, image, shrunk in zip(rig, small.images(), small.rig, strict=True):
        width, height = (side - side % factor for side in big.image_size)
        assert shrunk.image_size == (width // factor, height // factor)
        assert image.shape == shrunk.image_size[::-1]
        whole = frames["first"][big.name][:height, :width]
        assert image.mean() == pytest.approx(whole.mean(), rel=1e-6)
        # pixel (column 1, row 0) of the small image is the block of the big one beside the first
        centre = [[factor + (factor - 1) / 2, (factor - 1) / 2]]
        np.testing.assert_allclose(shrunk.rays([[1, 0]])[1], big.rays(centre)[1], atol=1e-12)


def test_shrinking_twice_is_shrinking_by_the_product(folder):
    scan = load_scan(folder).only("right")
    twice, once = scan.scaled(2).scaled(2), scan.scaled(4)
    assert twice.rig["right"].image_size == once.rig["right"].image_size
    np.testing.assert_allclose(twice.images()[0], once.images()[0], rtol=1e-6)


def test_a_shrunk_pixel_is_usable_only_when_all_of_it_is(folder, edit):
    mask = np.ones((5, 7), np.uint8)
    mask[3, 2] = 0
    write_image(folder / "mask.png", mask)
    edit(folder, lambda content: content.update(corrections={"mask": {"left": "mask.png"}}))
    images, masks = load_scan(folder).scaled(2).read()
    assert np.argwhere(~masks[0]).tolist() == [[1, 1]]
    assert masks[1].all()
    assert np.isfinite(images[0]).all()


def test_holding_cameras_out(folder, frames):
    scan = load_scan(folder)
    assert scan.without("left").rig.names == ("right",)
    assert scan.only("right").rig.names == ("right",)
    assert scan.only("right", "left").rig.names == ("left", "right")
    np.testing.assert_array_equal(scan.without("left").images()[0], frames["first"]["right"])


def test_unknown_names_list_the_known_ones(folder, assert_refused):
    scan = load_scan(folder)
    assert_refused(lambda: scan.images("third"), "scan.yaml", "'third'", "first, second")
    assert_refused(lambda: scan.without("cam9"), "scan.yaml", "'cam9'", "left, right")
    assert_refused(lambda: scan.only("cam9"), "'cam9'", "left, right")
    assert_refused(lambda: scan.without("left", "right"), "cameras", "none")


@pytest.mark.parametrize("factor", [0, 1.5, -2, 6])
def test_bad_scales(folder, factor, assert_refused):
    assert_refused(lambda: load_scan(folder).scaled(factor), "scale", f"found {factor}")
