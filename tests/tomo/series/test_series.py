from dataclasses import replace

import numpy as np
import pytest

from tomo import Options, Scan
from tomo.measurement import NoiseModel
from tomo.metrics import nrmse
from tomo.operators import Absorption
from tomo.pipeline.trace import through_gas
from tomo.series import make_plan, reconstruct_series
from tomo.series.frames import blocks_of, reader_of
from tomo.series.plan import weighted
from tomo.series.run import solve_block
from tomo.series.solving import solved_together

pytestmark = pytest.mark.usefixtures("quick_choices")


def results_of(plan, block):
    read = reader_of(plan.scan, plan.screened)
    return solve_block(plan, block, [read(plan.places[place]) for place in block])


def volumes_of(plan, block):
    return {place: result.volume for place, result in results_of(plan, block)}


def test_every_frame_is_complete_and_has_its_figures(film, undisturbed):
    assert undisturbed.complete.all()
    held_out = film.rig.names.index(film.options.hold_out[0])
    psnr = undisturbed.group["psnr"][:]
    assert np.isfinite(psnr[:, held_out]).all()
    assert np.isnan(np.delete(psnr, held_out, axis=1)).all()
    assert (undisturbed.group["relative_residual"][:] < 0.2).all()
    totals = [float(truth.sum()) for truth in film.truths]
    np.testing.assert_allclose(undisturbed.group["total_emission"][:], totals, rtol=0.05)


def test_a_block_alone_has_the_bits_that_it_has_among_others(plan, undisturbed):
    first, last = blocks_of(undisturbed.n_frames)
    for place, volume in {**volumes_of(plan, last), **volumes_of(plan, first)}.items():
        assert np.array_equal(volume, undisturbed.volume(place))


def test_bits_do_not_depend_on_the_number_of_threads(plan, on_threads):
    block = blocks_of(11)[1]
    with on_threads(1):
        one = volumes_of(plan, block)
    with on_threads(2):
        two = volumes_of(plan, block)
    assert all(np.array_equal(one[place], two[place]) for place in block)


def test_held_out_images_change_no_bit_of_a_volume(film, undisturbed):
    rng = np.random.default_rng(0)
    name = film.options.hold_out[0]
    noise = rng.uniform(0, 3, film.images[name].shape)
    scan = Scan.from_arrays(film.rig, {**film.images, name: noise}, film.grid)
    other = make_plan(scan, film.grid, film.options, tuple(range(undisturbed.n_frames)))
    psnr = undisturbed.group["psnr"][:, film.rig.names.index(name)]
    for place, result in results_of(other, blocks_of(undisturbed.n_frames)[-1]):
        assert np.array_equal(result.volume, undisturbed.volume(place))
        assert result.by_camera["psnr"][name] < psnr[place] - 1


def test_light_that_no_key_frame_shows_is_reconstructed(film, as_given):
    """The voxels of a block are those of its own frames, not of the key frames."""
    dark = {name: np.zeros_like(images) for name, images in film.images.items()}
    for name, images in film.images.items():
        dark[name][:8] = images[:1]  # the key frames show the first moment alone
        dark[name][8:] = images[8:]
    scan = Scan.from_arrays(film.rig, dark, film.grid)
    options = Options(frames=":", key_frames=1, temporal="off", **as_given)
    first, last = blocks_of(len(film.truths))
    plan = make_plan(scan, film.grid, options, (*first, *last))
    for place, volume in volumes_of(plan, last).items():
        assert nrmse(volume, film.truths[place]) < 0.1


def test_dark_frames_are_dark_volumes(film, tmp_path, as_given):
    images = {name: each.copy() for name, each in film.images.items()}
    for each in images.values():
        each[2] = 0
        each[8:] = 0
    scan = Scan.from_arrays(film.rig, images, film.grid)
    options = Options(frames=":", key_frames=3, **as_given | {"screen": True})
    store = reconstruct_series(scan, tmp_path / "out.zarr", options=options)
    for place in (2, 8, 10):
        assert not store.volume(place).any()
    assert nrmse(store.volume(4), film.truths[4]) < 0.1


@pytest.mark.parametrize(
    "options",
    [
        {"method": "mlem", "iterations": 15},
        {"basis": "voxel"},
        {"skip": False, "fit_gain": True, "iterations": 8},
        {
            "carving": "off",
            "projector": "on-the-fly",
            "method": "sirt",
            "iterations": 30,
            "basis": "voxel",
        },
    ],
    ids=lambda options: "-".join(options),
)
def test_other_options_serve_series_too(film, options, tmp_path, as_given):
    options = Options(frames="0:2", key_frames=1, **as_given | options)
    store = reconstruct_series(film.scan, tmp_path / "out.zarr", options=options)
    assert nrmse(store.volume(1), film.truths[1]) < 0.2
    assert store.complete.all()


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (Options(frames=":", compare=("mlem",)), "compare"),
        (Options(frames=":", time_limit=3.0), "time_limit"),
        (Options(frames=":", uncertainty=30), "uncertainty"),
        (Options(frames=":", method="wernet"), "method"),
        (Options(frames=":", frame="3"), "frame"),
        (Options(frames=":", hold_out=("nobody",)), "nobody"),
    ],
)
def test_options_for_single_frames_are_refused(film, options, part, tmp_path):
    with pytest.raises(ValueError, match=part):
        reconstruct_series(film.scan, tmp_path / "out.zarr", options=options)
    assert not (tmp_path / "out.zarr").exists()


def test_a_frame_does_not_depend_on_the_others_of_its_block(plan):
    read = reader_of(plan.scan, plan.screened)
    frames = [weighted(plan, plan.system, read(place)) for place in range(3)]
    together = [unknowns for _, unknowns in solved_together(plan, frames, plan.choice)]
    for frame, expected in zip(frames, together, strict=True):
        alone = solved_together(plan, [frame], plan.choice)[0][1]
        np.testing.assert_allclose(alone, expected, atol=2e-3 * expected.max())


def test_frames_that_absorb_their_own_light_come_out_brighter(film, plan):
    gas, mean = Absorption(emission=0.1), np.mean(film.truths, axis=0).astype(np.float32)
    seen = through_gas(plan.system.built.system, gas, mean, plan.options)
    built = replace(plan.system.built, absorption=gas, system=seen)
    absorbing = replace(plan, emission=mean, system=replace(plan.system, built=built))
    last = blocks_of(len(film.truths))[-1]
    clear = volumes_of(plan, last)
    for place, volume in volumes_of(absorbing, last).items():
        assert 1.05 < volume.sum() / clear[place].sum() < 1.4


@pytest.mark.parametrize("place", [0, 2])
def test_a_frame_without_light_leaves_the_weights_of_others_as_they_are(plan, place):
    noisy = (NoiseModel(0.001, 0.2),) * len(plan.registered.noise)
    built = replace(plan.system.built, weighting={"used": True})
    system = replace(plan.system, built=built)
    registered = replace(plan.registered, noise=noisy)
    plan = replace(plan, registered=registered, system=system)
    read = reader_of(plan.scan, plan.screened)
    bright = [read(number) for number in range(2)]
    dark = replace(bright[0], images=[np.zeros_like(image) for image in bright[0].images])
    frames = [weighted(plan, system, one) for one in bright]
    assert all(one.weights is not None for one in frames)
    expected = solved_together(plan, frames, plan.choice)
    frames.insert(place, weighted(plan, system, dark))
    found = solved_together(plan, frames, plan.choice)
    assert not found.pop(place)[1].any()
    for (_, ours), (_, theirs) in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
