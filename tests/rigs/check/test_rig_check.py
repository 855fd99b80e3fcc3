import re
from dataclasses import replace

import numpy as np
import pytest

from rigs import Distortion, Optics, RayTable, Rig, arc, camera_at, look_at, ring
from rigs.check import check_points
from rigs.check.convention_errors import find_convention_errors

EXTENT = np.array([16.0, 40.0, 16.0])
POINTS = np.stack(
    np.meshgrid(
        *[np.linspace(-0.49, 0.49, n) * e for n, e in zip((5, 9, 5), EXTENT, strict=True)]
    ),
    axis=-1,
).reshape(-1, 3)
FLIP = np.diag([1.0, -1.0, -1.0])


def a_ring(count=9, **options):
    return ring(count, distance=900.0, image_size=(70, 110), footprint=0.5, **options)


def check(rig, **options):
    return check_points(rig, POINTS, EXTENT, 0.5, **options)


def changed(rig, change, *names):
    names = names or rig.names
    return replace(rig, cameras=tuple(change(c) if c.name in names else c for c in rig))


def found(answer, words, level=None):
    some = [f for f in answer.findings if words in f.text and level in (None, f.level)]
    assert len(some) == 1, [(f.level, f.cameras, f.text) for f in answer.findings]
    return some[0]


def test_a_sound_ring_is_good():
    answer = check(a_ring())
    assert answer.assessment == "good", answer.findings
    assert [f.level for f in answer.findings] == ["note"] * len(answer.findings)
    figures = answer.cameras[0]
    assert figures.sees == 1
    assert figures.footprint_in_voxels == pytest.approx(1, rel=0.02)
    assert figures.nearest_view == pytest.approx(20, abs=1e-6)
    assert 0.4 < figures.wavelength_without < 1.0
    assert figures.field_of_view == pytest.approx(
        np.degrees(2 * np.arctan(np.hypot(35, 55) / 1800))
    )


def turned_away(camera):
    R, t = look_at(camera.position, 2 * camera.position)
    return replace(camera, R=R, t=t)


def aimed_aside(camera):
    R, t = look_at(camera.position, (0, 10, 0))
    return replace(camera, R=R, t=t)


def coarse(camera):
    K = camera.camera_matrix * [[0.3, 1, 1], [1, 0.3, 1], [1, 1, 1]]
    return replace(camera, camera_matrix=K)


def upside_down(camera):
    turn = np.diag([-1.0, -1.0, 1.0])
    return replace(camera, R=turn @ camera.R, t=turn @ camera.t)


def millimetres_for_pixels(camera):
    return replace(camera, camera_matrix=[[8.0, 0, 34.5], [0, 8, 54.5], [0, 0, 1]])


def out_of_focus(camera):
    return replace(camera, optics=Optics(100.0, 1.4, 1000.0))


def half_the_matrix(camera):
    K = camera.camera_matrix * [[1, 1, 0.4], [1, 1, 0.4], [1, 1, 1]]
    return replace(camera, camera_matrix=K)


def not_square(camera):
    return replace(
        camera, camera_matrix=camera.camera_matrix * [[1, 1, 1], [1, 0.7, 1], [1, 1, 1]]
    )


@pytest.mark.parametrize(
    ("change", "words", "level"),
    [
        (turned_away, "OpenGL", "fault"),
        (turned_away, "turned away", "fault"),
        (aimed_aside, "cut off toward -y", "warning"),
        (coarse, "pixels 3.3 voxels wide, those of most cameras 1", "warning"),
        (upside_down, "upside down", "warning"),
        (millimetres_for_pixels, "given in millimetres", "fault"),
        (out_of_focus, "out of focus by up to", "warning"),
        (half_the_matrix, "another image size", "warning"),
        (not_square, "pixels are usually square", "warning"),
    ],
)
def test_the_camera_responsible_is_named(change, words, level):
    answer = check(changed(a_ring(), change, "cam04"))
    assert found(answer, words, level).cameras == ("cam04",)
    assert answer.assessment == ("not usable" if level == "fault" else "limited")


def test_a_gap_names_its_neighbours_and_where_a_camera_would_close_it():
    answer = check(arc(7, 90.0, distance=900.0, image_size=(70, 110), footprint=0.5))
    finding = found(answer, "as large as the volume itself", "warning")
    assert finding.cameras == ("cam00", "cam06")
    assert "least: flat layers across z (23 mm)" in finding.text
    assert "900, 0, 0), or opposite, would close the largest gap" in finding.text


def test_the_details_that_views_measure_are_said_and_limit_only_rigs_that_miss_whole_shapes():
    good = check(a_ring(9))
    assert "half of all details down to 4.1 voxels (2 mm)" in found(good, "details", "note").text
    assert check(a_ring(5)).assessment == "good"
    for count in (2, 3, 4, 6):  # one line, three, two, three
        assert found(check(a_ring(count)), "shapes along it are a guess", "warning")


def test_lines_of_sight_that_miss_by_less_than_a_tenth_of_a_voxel_are_no_finding():
    miss = {"ray_miss_predicted": 0.04}
    answer = check(replace(a_ring(), calibration=miss))
    assert answer.ray_miss == 0.04
    assert not any("miss each other" in finding.text for finding in answer.findings)


def test_the_next_camera_is_named_for_good_rigs_too_with_what_it_would_add():
    rig = a_ring()
    answer = check(rig)
    text = found(answer, "would close the largest gap", "note").text
    spot = [float(value) for value in re.search(r"a camera at \((.*?)\)", text)[1].split(", ")]
    own = [
        float(x)
        for x in re.search(r"half down to (\S+) mm, 90 % to (\S+), least (\S+)", text).groups()
    ]
    added = replace(rig[0], name="new", R=(pose := look_at(spot, (0, 0, 0)))[0], t=pose[1])
    after = check(replace(rig, cameras=(*rig.cameras, added))).resolved
    assert own == pytest.approx([after.half, after.nine_tenths, after.worst], rel=0.05)
    assert after.half < answer.resolved.half


@pytest.mark.parametrize("voxel", [0.05, 0.5, 4.0])
def test_one_grid_is_proposed_whatever_grid_was_given(voxel):
    rig = ring(7, distance=900.0, image_size=(700, 1100), footprint=0.05)
    text = found(check_points(rig, POINTS + np.array([0, 3, 0]), EXTENT, voxel), "try --grid").text
    shape, spacing = re.search(r"--grid (\S+) --spacing (\S+)", text).groups()
    assert np.array([int(n) for n in shape.split("x")]) * float(spacing) == pytest.approx(
        EXTENT, abs=float(spacing)
    )
    assert 0.3 <= float(spacing) <= 0.5  # an eighth of 2.7 mm, pixels of 0.05 mm
    assert "--center 0,3,0" in text
    assert "--scale" in text
    shrunk = changed(rig, lambda c: c.scaled(1 / int(text.rsplit(" ", 1)[1])))
    followed = check_points(shrunk, POINTS, EXTENT, float(spacing))
    assert not any("try --grid" in finding.text for finding in followed.findings)


def test_cameras_that_nobody_measured_are_not_called_good_in_silence():
    rig = changed(a_ring(), lambda c: replace(c, status="nominal"))
    answer = check(rig)
    text = found(answer, "0.2 of a pixel was assumed, 0.1 mm in the volume", "warning").text
    assert "1 mm, as by a ruler, is 2 pixels here" in text
    assert "--pixel-accuracy" in text
    assert "--refine-cameras nominal" in text
    assert answer.assessment == "limited"
    assert check(rig, pixel_accuracy=0.2).assessment == "good"  # now somebody answers for it
    measured = replace(rig, calibration={"ray_miss_predicted": 0.04})
    assert check(measured).assessment == "good"
    one = changed(a_ring(), lambda c: replace(c, status="nominal"), "cam03")
    assert found(check(one), "was assumed", "warning").cameras == ("cam03",)
    foreign = changed(a_ring(), lambda c: replace(c, status="calibrated"))
    assert "does not say how exact" in found(check(foreign), "was assumed", "note").text
    assert not any("assumed" in finding.text for finding in check(a_ring()).findings)


def three(focal_length, distance, target=(0, 0, 0)):
    angles = np.radians([0, 60, 120])
    places = [(distance * np.sin(a), 0, distance * np.cos(a)) for a in angles]
    lens = {"image_size": (200, 200), "focal_length": focal_length, "pixel_pitch": 0.02}
    cameras = [camera_at(f"c{n}", p, target, **lens) for n, p in enumerate(places)]
    return Rig(tuple(replace(camera, status="virtual") for camera in cameras))


def test_a_volume_cut_off_names_the_lens_and_the_distance_that_see_all():
    texts = " ".join(f.text for f in check(three(50.0, 400.0)).findings)
    words = re.findall(r"a lens of at most (\S+) mm, or a distance of at least (\S+) mm", texts)
    lens, distance = min(float(one[0]) for one in words), max(float(one[1]) for one in words)
    for cured in (three(lens, 400.0), three(50.0, distance)):
        assert not any("cut off" in f.text for f in check(cured).findings)
    for almost in (three(1.1 * lens, 400.0), three(50.0, 0.9 * distance)):
        assert any("cut off" in f.text for f in check(almost).findings)
    for rig, cure in (
        (three(30.0, 400.0, target=(0, 15, 0)), "aimed at the middle of the volume, it would see"),
        (changed(three(50.0, 400.0), lambda c: replace(c, optics=None)), "pixels of focal length"),
    ):
        assert any(cure in f.text for f in check(rig).findings if "cut off" in f.text)


def test_facing_cameras_count_once():
    answer = check(a_ring(8))
    finding = found(answer, "8 cameras give 4 different views", "note")
    assert finding.cameras == ("cam04", "cam05", "cam06", "cam07")
    assert "cam00 and cam04" in finding.text


def test_unseen_part_is_found_with_those_who_miss_it():
    answer = check(changed(a_ring(3), aimed_aside))
    finding = found(answer, "no camera sees", "fault")
    assert "toward -y" in finding.text
    percent = float(finding.text.split("sees ")[1].split("%")[0])
    assert percent == pytest.approx(100 * (answer.coverage.views == 0).mean(), abs=0.06)
    alone = check(changed(a_ring(3), aimed_aside, "cam01", "cam02"))
    assert found(alone, "a single camera sees").cameras == ("cam01", "cam02")


def test_a_part_too_small_for_a_tenth_of_a_per_cent_is_no_nothing():
    rig = changed(a_ring(3), aimed_aside)
    unseen = check(rig).coverage.views == 0
    weights = np.where(unseen, 1e-4 / unseen.sum(), (1 - 1e-4) / (~unseen).sum())
    answer = check(rig, weights=weights)
    found(answer, "less than 0.1% of the volume is seen by no camera", "warning")


def test_a_unit_that_nothing_can_convert_is_named():
    answer = check(replace(a_ring(), length_unit="parsec"))
    assert found(answer, "length_unit 'parsec' is none of m, dm, cm, mm", "warning")


def test_a_camera_inside_the_volume_and_a_single_camera():
    inside = changed(a_ring(), lambda c: replace(c, t=-c.R @ [1.0, 2.0, 3.0]), "cam02")
    assert "cam02" in found(check(inside), "inside the volume", "fault").cameras
    assert found(check(Rig((a_ring()[0],))), "single view gives no depth").level == "fault"


def test_ray_miss_is_the_calibration_s_where_there_is_one():
    rig = a_ring()
    assert check(rig, pixel_accuracy=0.4).ray_miss == pytest.approx(
        2 * check(rig).ray_miss, rel=0.01
    )
    answer = check(replace(rig, calibration={"ray_miss_predicted": 0.4}))
    assert answer.ray_miss == 0.4
    assert "0.8 voxels), by calibration" in found(answer, "miss each other", "warning").text
    cameras = {name: {"ray_miss": 0.1 if name != "cam03" else 0.9} for name in rig.names}
    summary = {"ray_miss_predicted": 0.4, "cameras": cameras}
    answer = check(replace(rig, calibration=summary))
    assert found(answer, "miss each other", "warning").cameras == ("cam03",)
    assert answer.cameras[3].ray_miss == 0.9
    other_unit = replace(rig, calibration=summary | {"length_unit": "m"})
    assert check(other_unit).ray_miss_from == "pixel accuracy"
    assert check(rig, pixel_accuracy=5.0).assessment == "not usable"


def in_micrometres(camera):
    K = camera.camera_matrix / [[1e3, 1e3, 1], [1, 1e3, 1], [1, 1, 1]]
    return replace(camera, camera_matrix=K)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (lambda c: replace(c, t=c.t / 1000), "t seems to be in metres, the grid millimetres"),
        (lambda c: replace(c, t=c.t * 1000), "t seems to be in millimetres, the grid metres"),
        (lambda c: replace(c, t=c.t / 25.4), "t seems to be in inches"),
        (lambda c: replace(c, R=FLIP @ c.R, t=FLIP @ c.t), "OpenGL's (y up, z backward)"),
        (lambda c: replace(c, R=c.R.T, t=c.position), "camera-to-world, expected"),
        (
            lambda c: replace(c, R=(FLIP @ c.R).T, t=c.position),
            "camera-to-world in OpenGL's axes",
        ),
        (lambda c: replace(c, t=c.position), "t seems to be the camera's position"),
        (in_micrometres, "pixel_pitch seems to be in micrometres"),
    ],
)
def test_errors_of_unit_and_convention_are_named(error, words):
    rig = a_ring(pitch_degrees=8.0, start_degrees=7.0)
    assert find_convention_errors(rig, POINTS, 0.5) == ()
    (all_wrong,) = find_convention_errors(changed(rig, error), POINTS, 0.5)
    assert words in all_wrong.text
    assert all_wrong.cameras == rig.names
    (one_wrong,) = find_convention_errors(changed(rig, error, "cam03"), POINTS, 0.5)
    assert words in one_wrong.text
    assert one_wrong.cameras == ("cam03",)
    assert check(changed(rig, error)).assessment == "not usable"


def test_a_grid_in_another_unit_is_reported_without_an_error_that_explains_it():
    tiny = Distortion()
    rig = changed(a_ring(), lambda c: replace(c, distortion=tiny))
    (error,) = find_convention_errors(rig, POINTS / 1e5, 0.5e-5)
    assert "different units" in error.text


@pytest.mark.parametrize(
    ("extent", "voxel", "words"),
    [((1, 2), 0.5, "extent"), ((1, 1, 0), 0.5, "extent"), ((1, 1, 1), 0, "voxel")],
)
def test_bad_input_is_reported(extent, voxel, words):
    with pytest.raises(ValueError, match=words):
        check_points(a_ring(), POINTS, extent, voxel)


def test_tables_of_rays_are_judged_like_the_cameras_they_stand_for():
    rig = a_ring(5)
    tables = replace(rig, cameras=tuple(RayTable.of(camera) for camera in rig))
    one, other = check(rig), check(tables)
    assert other.assessment == one.assessment
    assert [f.level for f in other.findings] == [f.level for f in one.findings]
    for wanted, other_figures in zip(one.cameras, other.cameras, strict=True):
        assert other_figures.sees == wanted.sees
        assert other_figures.footprint == pytest.approx(wanted.footprint, rel=1e-3)
        assert other_figures.nearest_view == pytest.approx(wanted.nearest_view, abs=0.01)
    blind = replace(tables, cameras=(*tables.cameras[:4], RayTable.of(turned_away(rig[4]))))
    assert "cam04" in found(check(blind), "nothing of the volume").cameras


def test_two_views_in_one_image_count_as_two_cameras_do():
    rig = a_ring(5)
    left, right = (RayTable.of(camera) for camera in rig[:2])
    width, height = rig[0].image_size
    directions = np.concatenate([left.directions, right.directions], axis=1)
    directions[:, width] = np.nan  # the edge of the mirror
    origins = np.repeat([left.position, right.position], width, axis=0)
    table = RayTable("split", np.broadcast_to(origins, (height, 2 * width, 3)), directions)
    far = np.linalg.norm(table.position - [left.position, right.position], axis=1)
    assert far.min() < 1e-3  # not between both, where the views cross
    answer = check(replace(rig, cameras=(table, *rig.cameras[2:])))
    assert not any("inside the volume" in finding.text for finding in answer.findings)
    own = answer.coverage.directions[:, 0]
    truth = [answer.coverage.points - camera.position for camera in (left, right)]
    off = [1 - (own * t / np.linalg.norm(t, axis=1, keepdims=True)).sum(axis=1) for t in truth]
    assert np.minimum(*off)[answer.coverage.seen[0]].max() < 1e-9
    assert answer.cameras[0].footprint == pytest.approx(check(rig).cameras[0].footprint, rel=0.02)


def test_points_stand_for_the_parts_of_the_volume_that_they_are_given():
    rig = changed(a_ring(3), aimed_aside)
    weights = np.where(POINTS[:, 1] < 0, 3.0, 1.0)
    answer = check_points(rig, POINTS, EXTENT, 0.5, weights=weights)
    unseen = answer.coverage.views == 0
    assert answer.fraction(unseen) == pytest.approx(weights[unseen].sum() / weights.sum())
    sees = weights[answer.coverage.seen[1]].sum() / weights.sum()
    assert answer.cameras[1].sees == pytest.approx(sees)
    with pytest.raises(ValueError, match="weights: found shape"):
        check_points(rig, POINTS, EXTENT, 0.5, weights=[1, 2])
