import numpy as np
import pytest
import tifffile

from rigs.recordings import is_integer_image, read_image, write_image

RAMP = np.arange(12, dtype=np.uint8).reshape(3, 4)


def test_a_folder_in_place_of_an_image_is_said_to_be_one(tmp_path):
    with pytest.raises(ValueError, match=r"found a folder, expected one image"):
        read_image(tmp_path)


def test_floats_stay_as_they_are(tmp_path):
    image = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32) * 1e3
    write_image(tmp_path / "a.tif", image)
    found = read_image(tmp_path / "a.tif")
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, image)


def test_nan_is_counted_and_placed_unless_masked(tmp_path):
    image = np.ones((4, 5), np.float32)
    image[1, 3] = np.nan
    image[2, 0] = np.inf
    write_image(tmp_path / "a.tif", image)
    with pytest.raises(ValueError, match=r"a\.tif: found 2 NaN.* row 1, column 3"):
        read_image(tmp_path / "a.tif")
    usable = np.ones((4, 5), bool)
    usable[1, 3] = False
    with pytest.raises(ValueError, match=r"a\.tif: found 1 NaN.* row 2, column 0"):
        read_image(tmp_path / "a.tif", usable=usable)
    usable[2, 0] = False
    found = read_image(tmp_path / "a.tif", usable=usable)
    assert found[1, 3] == found[2, 0] == 0
    assert found.sum() == 18


@pytest.mark.parametrize(
    ("photometric", "more", "message"),
    [
        ("palette", {"colormap": np.zeros((3, 256), np.uint16)}, "found numbers of a palette"),
        ("logl", {}, "found logarithms"),
        ("miniswhite", {}, "found white stored as zero"),
    ],
)
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_tiff_whose_numbers_are_no_intensities_is_refused(
    tmp_path, photometric, more, message, compression
):
    kind = {"photometric": photometric, "compression": compression}
    tifffile.imwrite(tmp_path / "a.tif", RAMP, **kind, **more)
    with pytest.raises(ValueError, match=rf"a\.tif: not a readable image: {message}"):
        read_image(tmp_path / "a.tif")


def test_bad_arguments_of_write(tmp_path):
    for name, image in [
        ("a.png", np.zeros((3, 4), np.float32)),
        ("a.tif", np.zeros((3, 4, 3), np.uint8)),
        ("a.tif", np.zeros((3, 4), np.int64)),
        ("a.bmp", RAMP),
    ]:
        with pytest.raises(ValueError, match=name):
            write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


def test_missing_and_unknown_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.tif: no such image file"):
        read_image(tmp_path / "none.tif")
    with pytest.raises(ValueError, match=r"a\.txt: found suffix '\.txt'"):
        read_image(tmp_path / "a.txt")


def test_integers_are_known_by_the_content_of_a_file(tmp_path):
    for name, dtype in (("a.tif", np.uint16), ("b.tif", np.float32), ("c.png", np.uint8)):
        write_image(tmp_path / name, RAMP.astype(dtype))
        assert is_integer_image(tmp_path / name) == (name != "b.tif")
    (tmp_path / "c.png").rename(tmp_path / "c.tif")
    assert is_integer_image(tmp_path / "c.tif")
    (tmp_path / "d.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:9])
    with pytest.raises(ValueError, match=r"d\.tif: not a readable image: "):
        is_integer_image(tmp_path / "d.tif")


def test_tiles_may_be_larger_than_the_image(tmp_path):
    image = np.random.default_rng(0).integers(0, 4095, (300, 400), dtype=np.uint16)
    for tile in ((256, 256), (1024, 1024)):
        tifffile.imwrite(tmp_path / "a.tif", image, tile=tile, compression="zlib")
        np.testing.assert_allclose(read_image(tmp_path / "a.tif"), image / 65535, rtol=1e-6)
