from xml.etree import ElementTree

import numpy as np
import pytest

from tomo.io import read_volume
from tomo.series import SeriesStore
from tomo.series.export import export_series


def test_a_pvd_names_a_file_and_a_time_for_every_frame(undisturbed, tmp_path):
    written = export_series(undisturbed, tmp_path / "flame.pvd", "pvd", [2, 5])
    root = ElementTree.parse(written).getroot()
    assert root.get("type") == "Collection"
    entries = root.findall("./Collection/DataSet")
    assert [float(one.get("timestep")) for one in entries] == [2, 5]
    for entry, place in zip(entries, (2, 5), strict=True):
        data, grid, unit = read_volume(tmp_path / entry.get("file"))
        assert np.array_equal(data, undisturbed.volume(place))
        np.testing.assert_allclose(grid.origin, undisturbed.grid.origin)
        assert unit == undisturbed.attributes["length_unit"]


def test_npz_files_are_named_by_the_numbers_of_frames(undisturbed, tmp_path):
    export_series(undisturbed, tmp_path / "volumes", "npz", range(3))
    files = sorted((tmp_path / "volumes").iterdir())
    assert [one.name for one in files] == [f"frame_{n:06d}.npz" for n in range(3)]
    assert np.array_equal(read_volume(files[1])[0], undisturbed.volume(1))


def test_frames_that_are_not_complete_are_named(undisturbed, tmp_path):
    store = SeriesStore.create(
        tmp_path / "out.zarr", undisturbed.grid, [0, 1], [0, 1], undisturbed.attributes
    )
    with pytest.raises(ValueError, match="2 that are not complete, the first is 0"):
        export_series(store, tmp_path / "a.pvd", "pvd")


@pytest.mark.parametrize(
    ("to", "target", "part"), [("mp4", "a.mp4", "to: found"), ("pvd", "a.xml", "expected .pvd")]
)
def test_other_formats_are_refused(undisturbed, tmp_path, to, target, part):
    with pytest.raises(ValueError, match=part):
        export_series(undisturbed, tmp_path / target, to, [0])
