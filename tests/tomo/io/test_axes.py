"""Volumes whose axes run backwards or in another order, by formats that can say so."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.io import read_volume
from tomo.io._axes import in_order

SHAPE = (3, 4, 5)
VALUES = np.arange(60, dtype=np.float32).reshape(SHAPE)


def value_at(path_or_volume, point):
    data, grid, _ = path_or_volume
    return data.reshape(-1)[grid.voxel_of(np.asarray(point))]


@given(
    order=st.permutations([0, 1, 2]),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    spacing=st.tuples(*[st.floats(0.1, 10)] * 3),
    origin=st.tuples(*[st.floats(-100, 100)] * 3),
)
def test_every_voxel_stays_where_it_is(order, signs, spacing, origin):
    steps = np.zeros((3, 3))
    steps[range(3), order] = np.multiply(signs, spacing)
    data, first, edges = in_order(VALUES, np.array(origin), steps, "steps")
    assert (edges > 0).all()
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1).reshape(-1, 3)
    points = origin + index @ steps
    found = (points - first) / edges
    np.testing.assert_allclose(found, np.rint(found), atol=1e-9 * (1 + 100 / min(spacing)))
    np.testing.assert_array_equal(data[tuple(np.rint(found).astype(int).T)], VALUES.ravel())


def test_axes_that_are_nearly_along_the_worlds_are_taken_so():
    steps = np.diag([-1.0, 2.0, 3.0])
    steps[0, 1] = 1e-8
    assert in_order(VALUES, np.zeros(3), steps, "x")[2].tolist() == [1, 2, 3]
    steps[0, 1] = 1e-3
    with pytest.raises(ValueError, match=r"x: found .* expected axes along x, y and z"):
        in_order(VALUES, np.zeros(3), steps, "x")


def nrrd(path, **fields):
    found = {"type": "float", "dimension": 3, "sizes": "3 4 5", "encoding": "raw"}
    found |= {"endian": "little"} | {name.replace("_", " "): v for name, v in fields.items()}
    head = "\n".join(["NRRD0005", *(f"{name}: {value}" for name, value in found.items()), "", ""])
    path.write_bytes(head.encode() + VALUES.ravel(order="F").tobytes())
    return read_volume(path)


CELL, NODE = "cell cell cell", "node node node"
PER_AXIS = [  # fields, origin, spacing: Teem's nrrdAxisInfoPos by its definition
    (
        {"spacings": "0.5 1 2", "axis_mins": "-1.25 -2.5 -4", "centerings": CELL},
        (-1, -2, -3),
        None,
    ),
    ({"spacings": "0.5 1 2", "axis_mins": "-1 -2 -3", "centers": NODE}, (-1, -2, -3), None),
    ({"spacings": "0.5 1 2", "axis_mins": "-1 -2 -3"}, (-1, -2, -3), None),
    ({"spacings": "0.5 1 2", "axismins": "-1 -2 -3"}, (-1, -2, -3), None),
    ({"spacings": "0.5 1 2", "axis_maxs": "0 1 5", "centerings": NODE}, (-1, -2, -3), None),
    ({"axis_mins": "-1 -2 -3", "axis_maxs": "0 1 5"}, (-1, -2, -3), None),
    (
        {"axis_mins": "-1.25 -2.5 -4", "axis_maxs": "0.25 1.5 6", "centerings": CELL},
        (-1, -2, -3),
        None,
    ),
    (
        {"spacings": "0.5 1 2", "axis_mins": "-1 nan -3", "centerings": "node cell node"},
        (-1, 0, -3),
        None,
    ),
    ({}, (0, 0, 0), (1, 1, 1)),
    ({"spacings": "0.5 1 2"}, (0, 0, 0), None),
]


@pytest.mark.parametrize(("fields", "origin", "spacing"), PER_AXIS, ids=range(len(PER_AXIS)))
def test_ends_of_an_nrrds_axes_are_of_cells_or_nodes(tmp_path, fields, origin, spacing):
    data, grid, _ = nrrd(tmp_path / "a.nrrd", **fields)
    np.testing.assert_allclose(grid.origin, origin, atol=1e-12)
    np.testing.assert_allclose(grid.spacing, spacing or (0.5, 1, 2))
    np.testing.assert_array_equal(data, VALUES)


def test_an_nrrds_axes_may_run_backwards(tmp_path):
    found = nrrd(tmp_path / "a.nrrd", axis_mins="0 0 5", axis_maxs="2 3 1")
    assert value_at(found, (0, 0, 5)) == VALUES[0, 0, 0]
    assert value_at(found, (2, 3, 1)) == VALUES[2, 3, 4]
    space = {"space_dimension": 3, "space_origin": "(10,20,30)"}
    found = nrrd(tmp_path / "b.nrrd", space_directions="(0,0,-2) (1,0,0) (0,3,0)", **space)
    assert found[0].shape == (4, 5, 3)
    assert found[1].spacing == (1, 3, 2)
    assert value_at(found, (10, 20, 30)) == VALUES[0, 0, 0]
    assert value_at(found, (12, 29, 28)) == VALUES[1, 2, 3]


@pytest.mark.parametrize("where", ["PointData", "CellData"])
def test_a_vtis_axes_may_run_backwards(tmp_path, where):
    text = " ".join(str(value) for value in VALUES.ravel(order="F"))
    last = [n - (where == "PointData") for n in SHAPE]
    extent = f"2 {2 + last[0]} 0 {last[1]} 0 {last[2]}"
    path = tmp_path / "a.vti"
    path.write_text(
        '<VTKFile type="ImageData" byte_order="LittleEndian">'
        f'<ImageData WholeExtent="{extent}" Origin="10 20 30" Spacing="1 2 3" '
        f'Direction="-1 0 0 0 0 1 0 1 0"><Piece Extent="{extent}"><{where}>'
        f'<DataArray type="Float32" format="ascii">{text}</DataArray>'
        f"</{where}></Piece></ImageData></VTKFile>"
    )
    found = read_volume(path)
    half = 0.5 * (where == "CellData")  # a cell's middle is half a step from its first point
    first = np.array([10 - 2 - half, 20 + 3 * half, 30 + 2 * half])
    assert value_at(found, first) == VALUES[0, 0, 0]
    assert value_at(found, first + np.array([-2, 9, 4])) == VALUES[2, 2, 3]
