"""Images in colour: equal channels are grey, one may be chosen, and transparency hides values."""

import cv2
import numpy as np
import pytest
import tifffile

from rigs.recordings import Still, is_integer_image, read_image

RANDOM = np.random.default_rng(0)
GREY = RANDOM.integers(0, 255, (6, 8), dtype=np.uint8)
COLOUR = RANDOM.integers(0, 255, (6, 8, 3), dtype=np.uint8)


def write(path, image):
    """Write an image by OpenCV; colours are given red first."""
    if image.ndim == 3:
        image = np.concatenate([image[:, :, 2::-1], image[:, :, 3:]], axis=-1)
    assert cv2.imwrite(str(path), image)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".ppm", ".webp"])
def test_equal_channels_are_a_grey_image(tmp_path, suffix):
    write(tmp_path / f"a{suffix}", np.dstack([GREY] * 3))
    np.testing.assert_allclose(read_image(tmp_path / f"a{suffix}"), GREY / 255, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".webp"])
@pytest.mark.parametrize("channel", ["r", "g", "b"])
def test_a_channel_may_be_chosen(tmp_path, suffix, channel):
    write(tmp_path / f"a{suffix}", COLOUR)
    if suffix == ".webp":  # OpenCV's are not exact
        return
    with pytest.raises(ValueError, match=r"whose 3 channels differ, .*channel='g', 'r' or 'b'"):
        read_image(tmp_path / f"a{suffix}")
    expected = COLOUR[:, :, "rgb".index(channel)] / 255
    found = read_image(tmp_path / f"a{suffix}", channel=channel)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_full_alpha_is_ignored_and_another_refused(tmp_path, suffix, kind):
    path, full = tmp_path / f"a{suffix}", np.iinfo(kind).max
    grey = GREY.astype(kind)
    write(path, np.dstack([grey, grey, grey, np.full_like(grey, full)]))
    np.testing.assert_allclose(read_image(path), grey / full, rtol=1e-6)
    alpha = np.full_like(grey, full)
    alpha[2, 3:5] = 7
    write(path, np.dstack([grey, grey, grey, alpha]))
    with pytest.raises(
        ValueError, match=f"found 2 transparent pixels, with alpha down to 7 of {full}"
    ):
        read_image(path)


def test_grey_and_alpha_in_a_tiff(tmp_path):
    both = np.dstack([GREY, np.full_like(GREY, 255)])
    tifffile.imwrite(
        tmp_path / "a.tif", both, photometric="minisblack", planarconfig="contig",
        extrasamples=["unassalpha"],
    )  # fmt: skip
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), GREY / 255, rtol=1e-6)


def test_a_grey_image_has_no_channel_to_choose(tmp_path):
    """It may be a mosaic, whose pixels of other colours would be taken too."""
    write(tmp_path / "a.png", GREY)
    with pytest.raises(ValueError, match=r"a\.png: found a grey image, .* like bayer='RGGB'"):
        read_image(tmp_path / "a.png", channel="g")
    found = read_image(tmp_path / "a.png", channel="g", must_have_channel=False)
    np.testing.assert_array_equal(found, read_image(tmp_path / "a.png"))


def test_of_more_channels_than_colours_one_is_asked_for():
    still = Still.of(np.arange(140.0).reshape(4, 5, 7))
    for channel in (None, "g", "7"):
        with pytest.raises(ValueError, match=r"found 7 channels, expected 0 to 6, .*channel='0'"):
            still.grey(channel)
    np.testing.assert_array_equal(still.grey("5"), still.pixels[:, :, 5])


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("way", ["ome", "imagej", "one page"])
def test_a_still_of_several_channels_has_the_one_asked_for(tmp_path, way, number):
    both = np.stack([GREY, GREY[::-1] // 2])
    file = tmp_path / "a.tif"
    if way == "one page":
        both = np.moveaxis(both, 0, -1)
        tifffile.imwrite(file, both, photometric="minisblack", planarconfig="contig")
        both = np.moveaxis(both, -1, 0)
    else:
        about = {"axes": "CYX", "Channel": {"Name": ["CH", "OH"]}}
        tifffile.imwrite(file, both, metadata=about, **{way: True})
    found = read_image(file, channel=str(number))
    np.testing.assert_allclose(found, both[number] / np.iinfo(GREY.dtype).max, rtol=1e-6)
    with pytest.raises(ValueError, match=r"a\.tif: .*expected 0 to 1, .*channel"):
        read_image(file, channel="2")
    assert is_integer_image(file)


def test_a_still_of_pages_without_channels_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.stack([GREY, GREY]), metadata=None)
    with pytest.raises(ValueError, match="found more than one page"):
        read_image(tmp_path / "a.tif", channel="0")


@pytest.mark.parametrize("kind", ["separated", "cielab", "icclab", "ycbcr"])
def test_colours_that_are_no_light_are_refused(tmp_path, kind):
    count = 4 if kind == "separated" else 3
    image = np.dstack([GREY] * count)
    subsampling = {"subsampling": (1, 1)} if kind == "ycbcr" else {}
    tifffile.imwrite(tmp_path / "a.tif", image, photometric=kind, **subsampling)
    with pytest.raises(ValueError, match="expected grey values"):
        read_image(tmp_path / "a.tif", channel="g")


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_file_that_says_that_it_is_a_mosaic_asks_for_its_colours(tmp_path, compression):
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="cfa", compression=compression)
    with pytest.raises(ValueError, match=r"a\.tif: found a mosaic .*bayer='RGGB', channel='g'"):
        read_image(tmp_path / "a.tif")
    found = read_image(tmp_path / "a.tif", bayer="RGGB", channel="g")
    np.testing.assert_allclose(found, GREY / 255, rtol=1e-6)  # `Mosaic` takes the pixels
