"""Kalibr's camera chains, written here by its documented formulas."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from rigs import Distortion, RayTable, formats


def motion(camera):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.R, camera.t
    return matrix


def kalibr_data(rig):
    lenses = {"none": "none", "brown": "radtan", "fisheye": "equidistant"}
    data = {}
    for index, camera in enumerate(rig):
        (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
        data[f"cam{index}"] = {
            "camera_model": "pinhole",
            "intrinsics": [fx, fy, cx, cy],
            "distortion_model": lenses[camera.distortion.model],
            "distortion_coeffs": list(camera.distortion.coefficients[:4]),
            "resolution": list(camera.image_size),
            "rostopic": f"/cam{index}/image_raw",
        }
        if index:
            link = motion(camera) @ np.linalg.inv(motion(rig[index - 1]))
            data[f"cam{index}"]["T_cn_cnm1"] = link.tolist()
    return data


def test_kalibr(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "fisheye", "none")
    radtan = Distortion("brown", rig[0].distortion.coefficients[:4])
    rig = replace(rig, cameras=(replace(rig[0], distortion=radtan), *rig.cameras[1:]))
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump(kalibr_data(rig)))
    assert formats.sniff(path) == "kalibr"
    found = formats.load(path)
    assert found.length_unit == "m"
    assert_same_views(found, rig.transformed(rig[0].R, rig[0].t))  # the world is cam0


def sphere_pixels(points, model, intrinsics, lens):
    """Pixels of points in camera axes, by the forward formulas of Kalibr's models."""
    x, y, z = points.T
    d = np.linalg.norm(points, axis=1)
    *parameters, fu, fv, pu, pv = intrinsics
    if model == "omni":
        (xi,) = parameters
        depth = z + xi * d
    elif model == "ds":
        xi, alpha = parameters
        z = xi * d + z
        depth = alpha * np.sqrt(x * x + y * y + z * z) + (1 - alpha) * z
    else:
        alpha, beta = parameters
        depth = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
    x, y = x / depth, y / depth
    k1, k2, p1, p2 = lens or (0, 0, 0, 0)
    q = x * x + y * y
    gain = 1 + k1 * q + k2 * q * q
    x, y = (
        x * gain + 2 * p1 * x * y + p2 * (q + 2 * x * x),
        y * gain + p1 * (q + 2 * y * y) + 2 * p2 * x * y,
    )
    return np.stack([fu * x + pu, fv * y + pv], axis=1)


@pytest.mark.parametrize(
    ("model", "intrinsics", "lens"),
    [
        ("omni", [0.8, 190.0, 191.0, 160.3, 119.2], [-0.1, 0.02, 1e-3, -5e-4]),
        ("omni", [1.2, 190.0, 191.0, 160.3, 119.2], []),
        ("ds", [-0.2, 0.59, 110.0, 111.0, 160.3, 119.2], []),
        ("eucm", [0.6, 1.1, 110.0, 111.0, 160.3, 119.2], []),
    ],
)
def test_kalibrs_wide_lenses_are_tables_of_rays(tmp_path, model, intrinsics, lens):
    data = {
        "cam0": {
            "camera_model": model,
            "intrinsics": intrinsics,
            "distortion_model": "radtan" if lens else "none",
            "distortion_coeffs": lens,
            "resolution": [320, 240],
        }
    }
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump(data))
    camera = formats.load(path)["cam0"]
    assert isinstance(camera, RayTable)
    _, directions = camera.rays()
    uv = np.stack([a.ravel() for a in np.meshgrid(np.arange(320), np.arange(240))], axis=1)
    seen = np.flatnonzero(np.isfinite(directions[:, 0]))
    some = np.random.default_rng(0).choice(seen, 200)
    found = sphere_pixels(3 * directions[some], model, intrinsics, lens)
    np.testing.assert_allclose(found, uv[some], rtol=0, atol=1e-6)
    assert directions[seen, 2].min() < 0.5  # wide indeed


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("cam0", "camera_model"), "mei", "camera cam0: camera_model: found 'mei', expected one"),
        (("cam1", "distortion_model"), "fov", "camera cam1: distortion_model: found 'fov'"),
        (("cam1", "T_cn_cnm1"), np.ones((4, 4)).tolist(), "camera cam1: T_cn_cnm1: found last ro"),
        (("cam0", "intrinsics"), [1, 2, 3], "camera cam0: intrinsics: found [1, 2, 3], expected"),
        (("cam0",), None, "camera cam1: found no cam0 before it"),
    ],
)
def test_what_is_wrong_in_kalibrs_files_is_named(
    refused_as, make_rig, mutated, tmp_path, path, value, message
):
    file = tmp_path / "camchain.yaml"
    file.write_text(yaml.safe_dump(mutated(kalibr_data(make_rig("fisheye", "none")), path, value)))
    refused_as(file, message, file, "kalibr")
