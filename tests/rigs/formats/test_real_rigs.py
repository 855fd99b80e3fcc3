"""Rigs of real image sets through the formats that hold them."""

import pytest

from rigs import formats


@pytest.mark.parametrize(
    "name", ["rig.yml", "rig.json", "transforms.json", "cameras.txt", "r.yaml"]
)
@pytest.mark.parametrize(
    "source", ["scalarflow/transforms.json", "dino_sparse_ring/dinoSR_par.txt"]
)
def test_they_come_back(test_data, assert_same_views, tmp_path, source, name):
    rig = formats.load(test_data / source)
    formats.save(rig, tmp_path / name)
    assert_same_views(formats.load(tmp_path / name), rig)
