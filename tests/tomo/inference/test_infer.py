"""What is wrong is found, nothing else is named, whatever the threads and the cameras' order."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from phantoms import GaussianBlobs
from tomo.inference.infer import infer
from tomo.inference.left_out import LeftOut, squared_errors
from tomo.inference.solve import first_fit, first_fits, next_fit
from tomo.inference.steps import Steps
from tomo.model import Absorbing, Background, Blur, FallOff, Gain, Pose
from tomo.simulation import simulate_images

OWN = (Gain(), Background(), Blur(), Pose())
ALL = (*OWN, FallOff(), Absorbing(own=False), Absorbing(own=True))
FEW = (Gain(), Pose())
WRONG, SHIFT = 2, (1.2, -0.8)  # pixels


@pytest.fixture(scope="module")
def shifted(observed):
    """Return the observation with a camera that the rig has beside its place."""
    observation, _ = observed
    cameras = list(observation.rig)
    cameras[WRONG] = cameras[WRONG].shifted(*SHIFT)
    return replace(observation, rig=replace(observation.rig, cameras=tuple(cameras)))


@pytest.fixture(scope="module")
def found(shifted, solve_quickly):
    with solve_quickly():
        return infer([shifted], FEW)


@pytest.fixture(scope="module")
def film(observed):
    """Return three moments of a flame that rises, each with noise of its own."""
    seen, _ = observed
    blobs = np.array([[1.0, -1.0, -0.6], [-1.5, 2.0, 1.6], [0.6, -3.0, 1.2]])
    frames = []
    for number in range(3):
        middles = blobs + number * np.array([[0.7, 0.9, -0.5], [0.6, 0.8, -0.9], [-0.8, 1.0, 0.4]])
        field = GaussianBlobs(middles, [1.3, 1.2, 0.9], [1.0, 0.8, 0.9])
        made = simulate_images(
            seen.rig, field, seen.grid, supersample=2, refine=3, noise=0.005, seed=number
        )
        frames.append(replace(seen, images=tuple(made.images.values())))
    return frames


def named(found):
    """Return the cameras that an effect was found of, by effect."""
    free = found.state.free.items()
    return {name: np.flatnonzero(one.any(axis=1)).tolist() for name, one in free if one.any()}


def test_nothing_is_found_of_exact_cameras(observed):
    observation, _ = observed
    found = infer([observation], ALL)
    assert named(found) == {}
    assert not found.state.has_outside
    assert not found.state.hidden.any()
    assert max(one.max() for one in found.scores.values()) < 1


def test_one_camera_is_found_and_no_other_named(shifted):
    """Nor a fall-off of all."""
    found = infer([shifted], ALL)
    assert named(found) == {"pose": [WRONG]}
    assert not found.state.has_outside
    assert not found.state.hidden.any()
    np.testing.assert_allclose(found.state.values["pose"][WRONG, :2], -np.array(SHIFT), atol=0.15)
    assert found.scores["pose"].argmax() == WRONG


def with_gain(observation, gain):
    """Return the observation with a gain of one camera."""
    images = list(observation.images)
    images[WRONG] = np.float32(gain) * images[WRONG]
    return replace(observation, images=tuple(images))


def test_a_gain_is_found_and_no_fall_off_of_all(observed):
    found = infer([with_gain(observed[0], 1.2)], ALL)
    assert named(found) == {"gain": [WRONG]}
    assert found.state.values["gain"][WRONG, 0] == pytest.approx(np.log(1.2), abs=0.02)


def test_the_bits_are_those_of_one_thread(shifted, found, on_threads, solve_quickly):
    threads = numba.get_num_threads()
    with on_threads(1 if threads > 1 else 2), solve_quickly():
        other = infer([shifted], FEW)
    for name, values in found.state.values.items():
        np.testing.assert_array_equal(other.state.values[name], values)
    np.testing.assert_array_equal(other.state.fits[0].unknowns, found.state.fits[0].unknowns)


def test_the_order_of_cameras_does_not_matter(shifted, found, solve_quickly):
    order = [3, 0, 5, 2, 1, 4]
    parts = {
        name: tuple(getattr(shifted, name)[k] for k in order)
        for name in ("images", "masks", "noise")
    }
    cameras = tuple(shifted.rig[k] for k in order)
    mixed = replace(shifted, rig=replace(shifted.rig, cameras=cameras), **parts)
    with solve_quickly():
        other = infer([mixed], FEW)
    for effect in FEW:  # single precision sums in another order, and the steps go on from there
        before, after = (one.state.values[effect.name] for one in (found, other))
        close = 0.02 * effect.deviation(shifted).max()
        np.testing.assert_allclose(after, before[order], atol=close)
    volume = found.state.fits[0].means
    np.testing.assert_allclose(other.state.fits[0].means, volume, atol=5e-3 * volume.max())


def beside(frames, shift):
    """Return frames with the same camera beside its place in all of them."""
    cameras = list(frames[0].rig)
    cameras[WRONG] = cameras[WRONG].shifted(*shift)
    rig = replace(frames[0].rig, cameras=tuple(cameras))
    return [replace(one, rig=rig) for one in frames]


def test_frames_of_a_film_share_what_is_found_and_nothing_else(film):
    film = film[:2]
    found = infer(beside(film, SHIFT), OWN)
    assert named(found) == {"pose": [WRONG]}
    np.testing.assert_allclose(found.state.values["pose"][WRONG, :2], -np.array(SHIFT), atol=0.1)
    for one, given in zip(found.state.fits, film, strict=True):
        assert one.observation.rig == found.state.fits[0].observation.rig
        alone = next_fit(first_fit(given)).means
        assert np.linalg.norm(one.means - alone) < 0.15 * np.linalg.norm(alone)


def test_nothing_is_found_of_exact_cameras_in_a_film(film):
    found = infer(film[:2], ALL)
    assert named(found) == {}
    assert not found.state.has_outside
    assert not found.state.hidden.any()


def test_frames_together_tell_more_than_one(film):
    """Steps from exact cameras: the mean of three frames' is less wrong than one frame's."""
    none = {e.name: np.zeros((6, len(e.parameters))) for e in OWN}
    fits = first_fits(film)

    def wrong(of):
        return np.square(Steps(of, OWN, none).own["pose"][:, :2]).mean()

    assert wrong(fits) < 0.7 * np.mean([wrong([one]) for one in fits])


def test_a_frame_without_light_changes_nothing(film):
    seen = replace(film[1], light=film[1].brightest)
    dark = replace(seen, images=tuple(0 * image for image in seen.images))
    one, both = (infer(beside(frames, SHIFT), OWN) for frames in ([seen], [seen, dark]))
    for name, values in one.state.values.items():
        np.testing.assert_allclose(both.state.values[name], values, atol=0.02)


def test_what_hides_the_flame_in_most_frames_is_left_out(film):
    film = film[:2]
    box, frames = (slice(12, 30), slice(8, 20)), []
    for one in film:
        images = [image.copy() for image in one.images]
        images[WRONG][box] *= 0.2
        frames.append(replace(one, images=tuple(images)))
    found = infer(frames, OWN)
    assert found.state.hidden.tolist() == [view == WRONG for view in range(6)]
    bright = np.median([one.images[WRONG] for one in film], axis=0) > 0.2 * film[0].brightest
    behind = np.zeros_like(bright)
    behind[box] = True
    for fit in found.state.fits:
        kept = fit.system.images(fit.usable.astype(np.float32))[WRONG] > 0
        assert kept[bright & behind].mean() < 0.3
        assert kept[~behind].mean() > 0.9


def test_the_image_of_another_moment_is_left_out(film):
    """No effect mends it; with it goes nothing that the other five say."""
    images = list(film[0].images)
    images[WRONG] = film[2].images[WRONG]
    found = infer([replace(film[0], images=tuple(images))], OWN)
    assert [found.state.takes_part(view) for view in range(6)] == [v != WRONG for v in range(6)]
    assert named(found) == {}
    (fit,) = found.state.fits
    right = next_fit(first_fit(film[0])).means
    assert np.linalg.norm(fit.means - right) < 0.25 * np.linalg.norm(right)


def test_a_view_of_what_no_other_shows_is_corrected_and_stays(film):
    """The last camera's image is predicted worst by the others, whatever it shows."""
    images = list(film[0].images)
    images[5] = 0.8 * images[5]
    found = infer([replace(film[0], images=tuple(images))], OWN)
    assert named(found) == {"gain": [5]}
    assert found.state.takes_part(5)


def test_left_out_pixels_are_not_remembered(film):
    """Their prediction is the same, whatever volume the fit had found with them."""
    (fit,) = first_fits(film[:1])
    other = replace(fit, unknowns=fit.unknowns[::-1])
    np.testing.assert_allclose(squared_errors([other]), squared_errors([fit]))


def test_a_camera_that_is_corrected_takes_part(found):
    assert all(found.state.takes_part(view) for view in range(6))


def test_what_predicts_left_out_pixels_worse_is_not_taken(shifted, monkeypatch, solve_quickly):
    """Each effect that explains the shift is barred in turn, and the search goes on and ends."""
    worse = LeftOut(np.zeros(9), np.tile([1.0, 2.0, 1.0], 3))
    judged = []
    monkeypatch.setattr(
        "tomo.inference.infer.predict_left_out",
        lambda before, after: judged.append(after) or worse,
    )
    assert not worse.is_better
    with solve_quickly():
        found = infer([shifted], OWN)
    assert named(found) == {}
    assert 1 < len(judged) <= 8
