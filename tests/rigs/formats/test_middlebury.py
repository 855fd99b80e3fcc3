import cv2
import numpy as np
import pytest

from rigs import formats, look_at

K = [[3310.4, 0.5, 316.73], [0.0, 3325.5, 200.55], [0.0, 0.0, 1.0]]


def line(name, R, t):
    return " ".join([name, *(f"{v:.17g}" for v in [*np.ravel(K), *np.ravel(R), *t])])


@pytest.fixture
def poses():
    rng = np.random.default_rng(3)
    return [look_at(rng.normal(size=3) * 0.4, rng.normal(size=3) * 0.01) for _ in range(3)]


@pytest.fixture
def par(tmp_path, poses):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"thing{i}.png"), np.zeros((48, 64), np.uint8))
    path = tmp_path / "thing_par.txt"
    path.write_text("\n".join(["3", *(line(f"thing{i}.png", *p) for i, p in enumerate(poses))]))
    return path


def test_points_appear_where_the_formula_of_the_sets_puts_them(par, poses):
    rig = formats.load(par)
    assert rig.names == ("thing0", "thing1", "thing2")
    assert rig.length_unit == "m"
    points = np.random.default_rng(0).normal(size=(200, 3)) * 0.02
    for camera, (R, t) in zip(rig, poses, strict=True):
        image = (np.array(K) @ np.column_stack([R, t])) @ np.column_stack([points, np.ones(200)]).T
        np.testing.assert_allclose(camera.project(points)[0], (image[:2] / image[2]).T, atol=1e-6)
        assert camera.image_size == (64, 48)
        assert camera.status == "calibrated"


def test_lengths_can_be_had_in_another_unit(par):
    metres, millimetres = formats.load(par), formats.load(par, length_unit="mm")
    np.testing.assert_allclose(millimetres[1].position, metres[1].position * 1000)
    assert millimetres.length_unit == "mm"


def test_the_size_is_asked_for_where_no_image_is(par):
    (par.parent / "thing1.png").unlink()
    with pytest.raises(ValueError, match=r"camera thing1: image_size: missing") as error:
        formats.load(par)
    assert str(error.value).startswith(f"{par}: ")
    assert formats.load(par, image_size=(64, 48))["thing1"].image_size == (64, 48)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda t: t.replace("3\n", "4\n", 1), "number of images: found '4' and 3 lines"),
        (lambda t: t + " 7", "camera thing2: found 22 values, expected 21"),
        (lambda t: t.replace("3325.5", "x", 1), "camera thing0: k22: found 'x', expected a finit"),
        (lambda t: t.replace("3325.5", "-1", 1), "camera thing0: camera_matrix: found focal"),
    ],
)
def test_what_is_wrong_is_named(refused_as, par, edit, message):
    par.write_text(edit(par.read_text()))
    refused_as(par, message, par, "middlebury")


def test_the_real_set(test_data):
    rig = formats.load(test_data / "dino_sparse_ring" / "dinoSR_par.txt")
    assert len(rig) == 16
    box = np.array([[-0.061897, -0.018874, -0.057845], [0.010897, 0.068227, 0.015495]])
    for camera in rig:
        assert camera.image_size == (640, 480)
        assert camera.inside(camera.project(box.mean(axis=0)[None])[0]).all()
