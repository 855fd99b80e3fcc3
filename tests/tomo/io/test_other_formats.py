"""Volumes of other programs that are only read: .npy, MetaImage and NIfTI."""

import builtins
import gzip
import re
import struct
import zlib

import numpy as np
import pytest

from tomo.io import read_volume

VALUES = np.random.default_rng(0).normal(size=(3, 4, 5)).astype(np.float32)


def npy(path, values=VALUES):
    np.save(path, values)
    return path


def test_an_array_is_read_with_a_spacing(tmp_path):
    path = npy(tmp_path / "a.npy")
    data, grid, unit = read_volume(path, spacing=(0.5, 1, 2), center=(1, 2, 3), length_unit="cm")
    np.testing.assert_array_equal(data, VALUES)
    assert (grid.spacing, grid.center, unit) == ((0.5, 1, 2), (1, 2, 3), "cm")
    np.save(path, np.asfortranarray(VALUES.astype(">f8")))
    data, grid, unit = read_volume(path, spacing=0.5)
    np.testing.assert_array_equal(data, VALUES)
    assert (grid.spacing, grid.center, unit) == ((0.5,) * 3, (0, 0, 0), "mm")


def test_an_array_without_a_spacing_is_asked_for_it(tmp_path):
    path = npy(tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"a\.npy: spacing: missing in a \.npy, expected a vox"):
        read_volume(path)
    with pytest.raises(ValueError, match=r"a\.npy: .*spacing: found -1"):
        read_volume(path, spacing=-1)
    npz = tmp_path / "b.npz"
    np.savez(npz, data=VALUES, origin=np.zeros(3), spacing=np.ones(3))
    for given in ({"spacing": 2.0}, {"center": (0, 0, 0)}, {"length_unit": "m"}):
        (name,) = given
        with pytest.raises(ValueError, match=rf"b\.npz: {name}: found .* given, expected none"):
            read_volume(npz, **given)


HOSTILE = {
    "objects": (np.array([print]), "not a readable .npy"),
    "flat": (np.zeros((3, 4)), "data: found float64 of shape (3, 4), expected numbers of shape"),
    "complex": (np.zeros((2, 2, 2), complex), "data: found complex128"),
    "text": (np.zeros((2, 2, 2), "U3"), "data: found <U3"),
    "infinite": (np.full((2, 2, 2), np.inf), "found 8 NaN or infinite voxels"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_arrays_that_are_no_volume(refused, tmp_path, kind):
    values, words = HOSTILE[kind]
    np.save(tmp_path / "made.npy", values, allow_pickle=True)
    content = (tmp_path / "made.npy").read_bytes()
    assert words in refused(lambda path: read_volume(path, spacing=1), "a.npy", content)


def test_an_array_that_claims_more_than_it_holds(refused, tmp_path):
    content = npy(tmp_path / "made.npy").read_bytes()
    huge = content.replace(b"(3, 4, 5)", b"(9999, 9999, 999)"[: len(b"(3, 4, 5)")], 1)
    claims = content.replace(b"(3, 4, 5), }        ", b"(30000, 40000, 50), }"[:20], 1)
    for bad in (content[:-1], content + b"x", huge, claims, b"", content[:20]):
        assert "not a readable" in refused(lambda p: read_volume(p, spacing=1), "a.npy", bad)


@pytest.mark.parametrize("name", ["a.raw", "a", "a.tif", "a.nii.zip", "a.gz"])
def test_an_unknown_ending_lists_those_that_are_read(tmp_path, name):
    expected = "expected one of .npz, .vti, .nrrd, .nhdr, .npy, .mha, .mhd, .nii, .nii.gz: "
    with pytest.raises(ValueError, match=re.escape(expected)):
        read_volume(tmp_path / name)


def mha(values=VALUES, more=b"", **fields):
    found = {
        "ObjectType": "Image",
        "NDims": 3,
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": "False",
        "TransformMatrix": "1 0 0 0 1 0 0 0 1",
        "Offset": "1 2 3",
        "ElementSpacing": "0.5 1 2",
        "DimSize": " ".join(map(str, values.shape)),
        "ElementType": "MET_FLOAT",
    }
    found |= fields | {"ElementDataFile": fields.get("ElementDataFile", "LOCAL")}
    head = "".join(f"{key} = {value}\n" for key, value in found.items() if value is not None)
    return head.encode() + values.ravel(order="F").tobytes() + more


def packed(values=VALUES):
    """Return a MetaImage of those values, whose header is of `VALUES`."""
    data = zlib.compress(values if isinstance(values, bytes) else values.tobytes(order="F"), 1)
    fields = {"CompressedData": "True", "CompressedDataSize": len(data)}
    return mha(**fields)[: -VALUES.nbytes] + data


PACKED = packed()


def nifti(values=VALUES, affine=((0.5, 0, 0, 1), (0, 1, 0, 2), (0, 0, 2, 3)), unit=2, **changed):
    """Return a NIfTI-1 file by the standard's table of fields."""
    head = bytearray(352)
    put = {
        0: ("i", 348),
        40: ("8h", 3, *values.shape, 1, 1, 1, 1),
        70: ("h", 16),
        72: ("h", 32),
        76: ("8f", 1, *np.linalg.norm(np.array(affine)[:, :3], axis=0), 1, 1, 1, 1),
        108: ("f", 352),
        123: ("b", unit),
        254: ("h", 1),  # sform_code
        280: ("12f", *np.ravel(affine)),
        344: ("4s", b"n+1\0"),
    }
    put |= {int(at[1:]): value for at, value in changed.items()}
    for at, (kind, *numbers) in put.items():
        struct.pack_into("<" + kind, head, at, *numbers)
    return bytes(head) + values.ravel(order="F").tobytes()


@pytest.fixture
def itk():
    return pytest.importorskip("SimpleITK", reason="SimpleITK is the reference for MetaImage")


@pytest.fixture
def nibabel():
    return pytest.importorskip("nibabel", reason="nibabel is an extra")


def test_metaimage(tmp_path):
    path = tmp_path / "a.mha"
    path.write_bytes(mha())
    data, grid, unit = read_volume(path)
    np.testing.assert_array_equal(data, VALUES)
    np.testing.assert_allclose(grid.origin, [1, 2, 3])
    assert (grid.spacing, unit) == ((0.5, 1, 2), "mm")
    big = VALUES.astype(">f8")
    path.write_bytes(mha(big, ElementType="MET_DOUBLE", BinaryDataByteOrderMSB="True"))
    np.testing.assert_array_equal(read_volume(path)[0], VALUES)


def test_a_metaimages_axes_are_where_its_own_library_has_them(itk, tmp_path):
    path = tmp_path / "a.mha"
    path.write_bytes(mha(TransformMatrix="0 -1 0 1 0 0 0 0 1"))
    data, grid, _ = read_volume(path)
    image = itk.ReadImage(str(path))
    for index in ((0, 0, 0), (2, 1, 3), (1, 3, 4)):
        place = np.array(image.TransformIndexToPhysicalPoint(index))
        assert data.ravel()[grid.voxel_of(place)] == VALUES[index]


@pytest.mark.parametrize("kind", ["raw", "zraw"])
def test_a_metaimage_header_beside_its_values(tmp_path, kind):
    stored = VALUES.ravel(order="F").tobytes()
    fields = {"CompressedData": str(kind == "zraw"), "ElementDataFile": f"a.{kind}"}
    (tmp_path / "a.mhd").write_bytes(mha(**fields)[: -len(stored)])
    with pytest.raises(ValueError, match=r"a\.mhd: .*ElementDataFile: found no file a\.z?raw"):
        read_volume(tmp_path / "a.mhd")
    (tmp_path / f"a.{kind}").write_bytes(zlib.compress(stored) if kind == "zraw" else stored)
    data, grid, _ = read_volume(tmp_path / "a.mhd")
    np.testing.assert_array_equal(data, VALUES)
    np.testing.assert_allclose(grid.origin, [1, 2, 3])
    (tmp_path / f"a.{kind}").write_bytes(stored[:-8] if kind == "raw" else b"x")
    with pytest.raises(ValueError, match=r"a\.mhd: "):
        read_volume(tmp_path / "a.mhd")


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_an_nrrd_header_beside_its_values(tmp_path, encoding):
    import nrrd

    header = {"space directions": np.diag([0.5, 1, 2]), "space origin": [1, 2, 3]}
    header |= {"space": "3D-right-handed", "space units": ["cm"] * 3, "encoding": encoding}
    nrrd.write(str(tmp_path / "a.nhdr"), VALUES, header, detached_header=True)
    data, grid, unit = read_volume(tmp_path / "a.nhdr")
    np.testing.assert_array_equal(data, VALUES)
    np.testing.assert_allclose(grid.origin, [1, 2, 3])
    assert (grid.spacing, unit) == ((0.5, 1, 2), "cm")
    (beside,) = [one for one in tmp_path.iterdir() if one.suffix != ".nhdr"]
    beside.unlink()
    with pytest.raises(ValueError, match=r"a\.nhdr: .*data file: found no file a\.raw"):
        read_volume(tmp_path / "a.nhdr")


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "A.NII.GZ"])
def test_nifti(nibabel, tmp_path, name):
    path = tmp_path / name
    content = nifti()
    path.write_bytes(gzip.compress(content) if name.lower().endswith("gz") else content)
    data, grid, unit = read_volume(path)
    np.testing.assert_array_equal(data, VALUES)
    np.testing.assert_allclose(grid.origin, [1, 2, 3], rtol=1e-6)
    assert (grid.spacing, unit) == ((0.5, 1, 2), "mm")


def test_niftis_world_is_that_of_its_affine(nibabel, tmp_path):
    affine = np.array([[0, -0.5, 0, 1], [1, 0, 0, 2], [0, 0, -2, 3.0]])
    path = tmp_path / "a.nii"
    path.write_bytes(nifti(affine=affine))
    data, grid, _ = read_volume(path)
    for index in ((0, 0, 0), (2, 1, 3), (1, 3, 4)):
        place = affine @ [*index, 1]
        assert data.ravel()[grid.voxel_of(place)] == VALUES[index]


def test_nifti_of_nibabel(nibabel, tmp_path):
    affine = np.array([[-0.5, 0, 0, 1], [0, 1, 0, 2], [0, 0, 2, 3.0], [0, 0, 0, 1]])
    for unit, expected in (("mm", "mm"), ("meter", "m"), ("micron", "um"), ("unknown", "mm")):
        image = nibabel.Nifti1Image(VALUES, affine)
        image.header.set_xyzt_units(unit)
        nibabel.save(image, tmp_path / "a.nii.gz")
        data, grid, found = read_volume(tmp_path / "a.nii.gz")
        place = (affine @ [2, 1, 3, 1])[:3]
        assert data.ravel()[grid.voxel_of(place)] == VALUES[2, 1, 3]
        assert found == expected


def test_a_nifti_header_is_not_mended_by_a_guess(nibabel, tmp_path, capfd):
    for broken in ({"_254": ("h", -3)}, {"_76": ("8f", 1, 0, 1, 1, 1, 1, 1, 1)}):
        path = tmp_path / "a.nii"
        path.write_bytes(nifti(**broken))
        with pytest.raises(ValueError, match=r"a\.nii: not a readable volume: "):
            read_volume(path)
    assert capfd.readouterr().err == ""


def test_without_nibabel_the_message_names_it(tmp_path, monkeypatch):
    load = builtins.__import__

    def without(name, *rest, **more):
        if name == "nibabel":
            raise ImportError(name)
        return load(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    (tmp_path / "a.nii").write_bytes(nifti())
    with pytest.raises(ValueError, match=r"a\.nii: .*nibabel.*pip install") as caught:
        read_volume(tmp_path / "a.nii")
    assert len(str(caught.value).splitlines()) == 1


BAD_MHA = [
    (b"", "ElementDataFile: missing"),
    (
        mha(ElementDataFile="/etc/hostname"),
        "ElementDataFile: found '/etc/hostname', expected a path inside the header's folder",
    ),
    (mha(ElementDataFile="LIST"), "found 'LIST', expected the name of one file"),
    (mha(ElementDataFile="x%03d.raw 1 9 1"), "expected the name of one file"),
    (mha(DimSize="99999 99999 9999", CompressedData="True"), "claim to hold"),
    (mha(DimSize="30 40 50"), "found 240 bytes of values, expected 240000: truncated"),
    (mha(DimSize="3 4"), "DimSize: found '3 4', expected 3 numbers"),
    (mha(DimSize=None), "DimSize: missing in the header"),
    (mha(ElementSpacing="1 0 1"), "grid spacing: found (1.0, 0.0, 1.0)"),
    (mha(Offset="1 2 x"), "Offset: found '1 2 x', expected 3 numbers"),
    (mha(DimSize="3 -4 5"), "DimSize: found '3 -4 5', expected whole numbers"),
    (mha(ElementType="MET_STRING"), "ElementType: found 'MET_STRING', expected one of MET_CHAR"),
    (mha(ElementNumberOfChannels=3), "ElementNumberOfChannels: found 3, expected 1"),
    (mha()[:-1], "truncated"),
    (mha().replace(b"NDims = 3", b"NDims = 3\nNDims = 3"), "NDims: found twice"),
    (b"\xff" * 1000, "ElementDataFile: missing"),
    (mha(NDims=2), "NDims: found 2, expected 3"),
    (mha(CompressedData="True", CompressedDataSize=240), "not a readable volume"),
    (PACKED[:-9], "truncated"),
    (packed(VALUES[:2]), "found 160 bytes of values, expected 240: truncated"),
    (packed(bytes(200 << 20)), "found compressed values of more than"),
    (mha(BinaryData="False"), "BinaryData: found False, expected True"),
    (mha(HeaderSize=-1), "HeaderSize: found -1, expected 0"),
]
ASKEW = mha(TransformMatrix="0.6 0.8 0 -0.8 0.6 0 0 0 1")
BAD_NIFTI = [
    (b"", "found 0 bytes, expected a NIfTI-1 header"),
    (nifti()[:300], "found 300 bytes"),
    (nifti(_344=("4s", b"ni1\0")), "found no NIfTI-1 header with the values in the same file"),
    (nifti(_40=("8h", 4, 3, 4, 5, 2, 1, 1, 1)), "dim: found [4, 3, 4, 5, 2, 1, 1, 1]"),
    (nifti(_40=("8h", 3, 3, -4, 5, 1, 1, 1, 1)), "dim: found [3, 3, -4, 5, 1, 1, 1, 1], expected"),
    (nifti(_40=("8h", 3, 30000, 30000, 30000, 1, 1, 1, 1)), "claim to hold"),
    (nifti(_108=("f", 1e30)), "found 32 bits a voxel from byte 1.0"),
    (nifti(_108=("f", float("nan"))), "bits a voxel from byte nan"),
    (nifti(_72=("h", -32)), "found -32 bits a voxel"),
    (gzip.compress(nifti())[:60], "found"),
    (b"\x1f\x8b" + b"\xff" * 100, "not a readable volume"),
]


@pytest.mark.parametrize(("content", "words"), BAD_MHA, ids=range(len(BAD_MHA)))
def test_bad_metaimages_are_refused(refused, content, words):
    assert words in refused(read_volume, "a.mha", content)


def test_axes_of_a_metaimage_askew_to_the_worlds_are_refused(refused):
    assert "TransformMatrix: found [[0.3, 0.4, 0.0]" in refused(read_volume, "a.mha", ASKEW)


@pytest.mark.parametrize(("content", "words"), BAD_NIFTI, ids=range(len(BAD_NIFTI)))
def test_bad_niftis_are_refused(refused, content, words):
    assert re.search(re.escape(words), refused(read_volume, "a.nii.gz", content))
