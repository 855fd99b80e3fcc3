import base64
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tomo import VoxelGrid
from tomo.io import read_volume, write_volume

SUFFIXES = [".npz", ".vti", ".nrrd"]
GRID = VoxelGrid((3, 4, 5), (0.5, 0.25, 1.0), (1.0, -2.0, 0.1))
VOLUME = np.arange(60, dtype=np.float32).reshape(3, 4, 5)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    shape=st.tuples(*[st.integers(1, 6)] * 3),
    spacing=st.tuples(*[st.floats(1e-3, 1e3)] * 3),
    center=st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    seed=st.integers(0, 99),
)
def test_round_trip(tmp_path, suffix, shape, spacing, center, seed):
    grid = VoxelGrid(shape, spacing, center)
    data = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    path = tmp_path / f"volume{suffix}"
    write_volume(path, data, grid, "m")
    found, found_grid, unit = read_volume(path)
    np.testing.assert_array_equal(found, data)
    assert found.dtype == np.float32
    assert found.grid == found_grid
    assert found.length_unit == "m"
    assert found_grid.shape == shape
    np.testing.assert_allclose(found_grid.spacing, spacing, rtol=1e-12)
    np.testing.assert_allclose(found_grid.origin, grid.origin, rtol=1e-12, atol=1e-9)
    assert unit == "m"


def test_vti_has_x_fastest_and_the_origin_at_the_first_voxels_centre(tmp_path):
    path = tmp_path / "volume.vti"
    write_volume(path, VOLUME, GRID, "mm")
    content = path.read_bytes()
    head, _, tail = content.partition(b'encoding="raw">\n_')
    assert b'WholeExtent="0 2 0 3 0 4"' in head
    origin = head.split(b'Origin="')[1].split(b'"')[0].split()
    np.testing.assert_allclose(np.array(origin, float), GRID.origin)
    assert np.frombuffer(tail[:8], "<u8")[0] == 60 * 4
    on_disk = np.frombuffer(tail[8 : 8 + 240], "<f4")
    np.testing.assert_array_equal(on_disk, VOLUME.transpose(2, 1, 0).ravel())


def test_nrrd_has_x_fastest(tmp_path):
    import zlib

    path = tmp_path / "volume.nrrd"
    write_volume(path, VOLUME, GRID, "mm")
    head, _, tail = path.read_bytes().partition(b"\n\n")
    assert b"sizes: 3 4 5" in head
    assert b'space units: "mm" "mm" "mm"' in head
    on_disk = np.frombuffer(zlib.decompress(tail, wbits=31), "<f4")
    np.testing.assert_array_equal(on_disk, VOLUME.transpose(2, 1, 0).ravel())


def vti(array, *, where="PointData", attributes="", extent="0 1 0 1 0 1", appended=""):
    return (
        f'<VTKFile type="ImageData" byte_order="LittleEndian" {attributes}>'
        f'<ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="2 2 2">'
        f'<Piece Extent="{extent}"><{where}>{array}</{where}></Piece></ImageData>{appended}'
        "</VTKFile>"
    )


def base64_array(values, compress):
    raw = np.asarray(values, "<f8").tobytes()
    if not compress:
        text = base64.b64encode(np.array(len(raw), "<u4").tobytes() + raw)
    else:
        blocks = [zlib.compress(raw[:24]), zlib.compress(raw[24:])]
        sizes = np.array([2, 24, len(raw) - 24, *map(len, blocks)], "<u4")
        text = base64.b64encode(sizes.tobytes()) + base64.b64encode(b"".join(blocks))
    return f'<DataArray type="Float64" format="binary">{text.decode()}</DataArray>'


@pytest.mark.parametrize("compress", [False, True])
def test_vti_of_other_programs_inline(tmp_path, compress):
    path = tmp_path / "other.vti"
    attributes = 'compressor="vtkZLibDataCompressor"' if compress else ""
    path.write_text(vti(base64_array(np.arange(8), compress), attributes=attributes))
    data, grid, unit = read_volume(path)
    np.testing.assert_array_equal(data, np.arange(8).reshape(2, 2, 2).transpose(2, 1, 0))
    np.testing.assert_allclose(grid.origin, 0)
    assert unit == "mm"


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(keep=st.floats(0, 0.98))
def test_a_truncated_file_is_one_line_naming_it(tmp_path, suffix, keep):
    whole, part = tmp_path / f"whole{suffix}", tmp_path / f"part{suffix}"
    if not whole.exists():
        write_volume(whole, VOLUME, GRID, "mm")
    content = whole.read_bytes()
    part.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(ValueError, match=f"part{suffix}: ") as caught:
        read_volume(part)
    assert "\n" not in str(caught.value)


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, data=np.array([print], dtype=object), origin=np.zeros(3), spacing=np.ones(3))
    with pytest.raises(ValueError, match=r"evil\.npz"):
        read_volume(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_a_value_that_is_not_finite_is_refused_and_nothing_is_written(tmp_path, bad):
    volume = VOLUME.astype(float)
    volume[1, 2, 3] = bad
    with pytest.raises(ValueError, match=r"volume\.npz: found 1 NaN.*\(1, 2, 3\)"):
        write_volume(tmp_path / "volume.npz", volume, GRID)
    np.savez(tmp_path / "in.npz", data=volume, origin=np.zeros(3), spacing=np.ones(3))
    with pytest.raises(ValueError, match=r"in\.npz: .*1 NaN.*\(1, 2, 3\)"):
        read_volume(tmp_path / "in.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["in.npz"]


@pytest.mark.parametrize(
    ("name", "shape", "unit", "message"),
    [
        ("v.foo", (3, 4, 5), "mm", r"suffix '\.foo', expected one of \.npz"),
        ("v.vti", (5, 4, 3), "mm", r"shape \(5, 4, 3\), expected \(3, 4, 5\)"),
        ("v.nrrd", (3, 4, 5), "m\nm", "length_unit"),
    ],
)
def test_bad_arguments_of_write(tmp_path, name, shape, unit, message):
    with pytest.raises(ValueError, match=message):
        write_volume(tmp_path / name, np.zeros(shape), GRID, unit)
    assert not list(tmp_path.iterdir())


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.vti: no such volume file"):
        read_volume(tmp_path / "none.vti")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"spacing": [1.0, 1.0]},
            r"spacing: found float64 of shape \(2,\), expected three numbers",
        ),
        ({"spacing": "x"}, r"spacing: found <U1 of shape \(\), expected three numbers"),
        ({"origin": 0.0}, r"origin: found float64 of shape \(\), expected three numbers"),
        ({"spacing": [-1.0, 1.0, 1.0]}, r"spacing: found \(-1.0, 1.0, 1.0\), expected positive"),
        (
            {"data": np.zeros((3, 4))},
            r"data: found float64 of shape \(3, 4\), expected numbers of",
        ),
    ],
)
def test_arrays_of_a_wrong_kind_are_named(tmp_path, fields, message):
    path = tmp_path / "volume.npz"
    good = {"data": VOLUME, "origin": GRID.origin, "spacing": GRID.spacing, "length_unit": "mm"}
    np.savez(path, **(good | fields))
    with pytest.raises(ValueError, match=message) as caught:
        read_volume(path)
    assert str(caught.value).startswith(f"{path}: not a readable volume: ")


@pytest.mark.parametrize("suffix", [".npz", ".nrrd"])
@pytest.mark.parametrize("more", [-1, 0, 1, 10_000, 200_000])
def test_what_is_written_is_never_too_densely_packed_to_be_read(
    tmp_path, monkeypatch, suffix, more
):
    """Readers weigh the values, writers the file, in which there is a header too."""
    from rigs.files import size_guard

    grid = VoxelGrid((64, 64, 64), 1.0)
    sparse = np.zeros(grid.shape, np.float32)
    sparse[30, 30] = np.random.default_rng(0).random(64)
    path = tmp_path / f"volume{suffix}"
    write_volume(path, sparse, grid)
    free = sparse.nbytes - size_guard.RATIO * path.stat().st_size
    monkeypatch.setattr(size_guard, "ALWAYS_ALLOWED", free + more)
    write_volume(path, sparse, grid)
    np.testing.assert_array_equal(read_volume(path)[0], sparse)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_carry_the_unit_of_their_values(tmp_path, suffix):
    path = tmp_path / f"volume{suffix}"
    write_volume(path, VOLUME, GRID, "mm", value_unit="full scales per mm")
    np.testing.assert_array_equal(read_volume(path)[0], VOLUME)
    if suffix == ".npz":
        assert str(np.load(path)["value_unit"]) == "full scales per mm"
    if suffix == ".nrrd":
        assert b"sample units: full scales per mm" in path.read_bytes()
    if suffix == ".vti":
        head = path.read_bytes().partition(b"<AppendedData")[0].decode()
        codes = head.partition('Name="value_unit"')[2].partition(">")[2].partition("<")[0]
        assert bytes(map(int, codes.split())) == b"full scales per mm\0"
    with pytest.raises(ValueError, match="value_unit: found"):
        write_volume(path, VOLUME, GRID, value_unit="counts\n")
