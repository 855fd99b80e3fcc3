import numpy as np
import pytest
import scipy.signal
import xarray

from tomo.export import export_series, spectrum
from tomo.grid import mean_and_rms


@pytest.fixture(scope="module")
def noise():
    """Return frames of noise on a large mean, with a tone in one voxel."""
    rng = np.random.default_rng(0)
    frames = (1000 + rng.normal(size=(96, 5, 4, 3))).astype(np.float32)
    frames[:, 2, 1, 0] += 5 * np.sin(2 * np.pi * 12.5 * np.arange(96) / 100)
    return frames


@pytest.fixture(scope="module")
def noisy(noise, filled, tmp_path_factory):
    return filled(tmp_path_factory.mktemp("noise") / "out.zarr", list(noise))


def test_mean_and_rms_are_those_of_all_frames_at_once(noise, noisy, tmp_path):
    mean, rms = mean_and_rms(noisy.volumes())
    np.testing.assert_allclose(mean, noise.mean(0, dtype=np.float64), rtol=1e-12)
    np.testing.assert_allclose(rms, noise.std(0, dtype=np.float64), rtol=1e-9)
    assert mean.grid == rms.grid == noisy.grid
    assert rms.value_unit == "counts per mm"
    written = export_series(noisy, tmp_path / "statistics.zarr", "statistics")
    with xarray.open_zarr(written, consolidated=False) as data:
        assert data["rms"].dims == ("x", "y", "z")
        np.testing.assert_allclose(data["mean"], mean, rtol=1e-6)
        np.testing.assert_allclose(data["rms"], rms, rtol=1e-6)
        np.testing.assert_allclose(data.x, noisy.group["x"][:])
        assert data["rms"].attrs["units"] == "counts per mm"


@pytest.mark.parametrize("buffer", [spectrum.BUFFER, 1])
def test_spectra_are_those_of_scipy_whatever_the_slabs(
    noise, noisy, tmp_path, monkeypatch, buffer
):
    monkeypatch.setattr(spectrum, "BUFFER", buffer)
    written = export_series(noisy, tmp_path / "spectrum.zarr", "spectrum")
    frequencies, power = scipy.signal.welch(noise, 100.0, nperseg=32, axis=0)
    with xarray.open_zarr(written, consolidated=False) as data:
        assert data.power.dims == ("frequency", "x", "y", "z")
        np.testing.assert_allclose(data.frequency, frequencies)
        np.testing.assert_allclose(data.power, power, rtol=1e-3, atol=1e-6)
        assert data.frequency.attrs["units"] == "Hz"
        assert data.power.attrs["units"] == "(counts per mm)^2 / Hz"
        tone = data.power[:, 2, 1, 0]
        assert float(data.frequency[int(np.argmax(tone.values))]) == pytest.approx(12.5)
        # its integral is the variance: that of the tone, 12.5, and of the noise
        assert float(tone.sum() * data.frequency[1]) == pytest.approx(13.5, rel=0.1)


@pytest.mark.parametrize(
    ("to", "places", "part"),
    [
        ("statistics", [1], "found 1, expected 2 or more"),
        ("spectrum", [1, 2, 3], "found 3, expected 4 or more"),
        ("spectrum", [1, 2, 3, 5, 6], "time: found frames 53 and 55 0.02 apart"),
    ],
)
def test_too_few_or_uneven_frames_are_refused(noisy, tmp_path, to, places, part):
    with pytest.raises(ValueError, match=part):
        export_series(noisy, tmp_path / "a.zarr", to, places)
    assert not list(tmp_path.iterdir())


def test_a_store_that_is_there_is_left_alone(noisy, tmp_path):
    (tmp_path / "a.zarr").mkdir()
    with pytest.raises(FileExistsError, match="is there already"):
        export_series(noisy, tmp_path / "a.zarr", "statistics")
