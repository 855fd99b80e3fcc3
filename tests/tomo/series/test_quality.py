"""How good the volumes of a film are, with all that choosing takes."""

from tomo import Options, reconstruct
from tomo.metrics import nrmse
from tomo.series import reconstruct_series


def test_volumes_are_as_good_as_those_of_single_frames(film, tmp_path, as_given):
    store = reconstruct_series(film.scan, tmp_path / "out.zarr", options=film.options)
    for place in (4, 9):
        options = Options(frame=f"frame_{place:03d}", hold_out=film.options.hold_out, **as_given)
        alone = reconstruct(film.scan, options=options)
        ours = nrmse(store.volume(place), film.truths[place])
        assert ours < 1.1 * nrmse(alone.volume, film.truths[place])
        assert ours < 0.1
