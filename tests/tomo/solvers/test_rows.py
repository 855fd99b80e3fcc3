import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tomo import Projector, Segments, VoxelGrid
from tomo.solvers._rows import merged_rows


@given(st.integers(0, 2**32 - 1))
def test_the_merged_rows_are_the_same_matrix_with_every_voxel_once_in_a_row(seed):
    random = np.random.default_rng(seed)
    counts = random.integers(0, 7, 6)
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    voxel = random.integers(0, 5, ptr[-1]).astype(np.int32)
    length = random.random(ptr[-1]).astype(np.float32)
    merged_ptr, merged_voxel, merged_length = merged_rows(
        Projector(Segments(ptr, voxel, length), VoxelGrid((5, 1, 1), 1.0)), "art"
    )
    for row in range(6):
        expected = np.zeros(5)
        np.add.at(expected, voxel[ptr[row] : ptr[row + 1]], length[ptr[row] : ptr[row + 1]])
        inside = slice(merged_ptr[row], merged_ptr[row + 1])
        assert len(set(merged_voxel[inside])) == len(merged_voxel[inside])
        found = np.zeros(5)
        found[merged_voxel[inside]] = merged_length[inside]
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_rows_without_repeats_are_not_copied(ring_system):
    segments = ring_system.projector.segments
    _, voxel, length = merged_rows(ring_system.projector, "art")
    assert voxel is segments.voxel
    assert length is segments.length
