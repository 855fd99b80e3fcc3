"""A film of volumes on disk: a Zarr v3 group that xarray reads, a checked chunk a frame."""

from __future__ import annotations

import json
import logging
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    import zarr

logger = logging.getLogger(__name__)


def create_array(
    group: zarr.Group,
    name: str,
    shape: Sequence[int],
    chunks: Sequence[int],
    dtype: DTypeLike,
    dims: Sequence[str],
    fill: float | None = None,
    **attributes: Any,
) -> zarr.Array:
    """Make an array whose chunks, all of them written, end in the CRC-32C of their bytes."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    return group.create_array(
        name,
        shape=tuple(shape),
        chunks=tuple(chunks),
        dtype=dtype,
        fill_value=fill,
        dimension_names=tuple(dims),
        attributes=attributes,
        compressors=(ZstdCodec(), Crc32cCodec()),
        config={"write_empty_chunks": True},
    )


def has_checksums(array: zarr.Array) -> bool:
    """Return whether the chunks of an array carry checksums."""
    from zarr.codecs import Crc32cCodec

    return any(isinstance(codec, Crc32cCodec) for codec in getattr(array.metadata, "codecs", ()))


@cache
def note_without_checksums(path: Path) -> None:
    """Log, once a process, that a store has no checksums."""
    logger.warning(
        "%s: found no checksums, as earlier versions wrote it: a chunk that is cut or missing is "
        "noticed, a flipped bit may not be",
        path,
    )


def chunk_file(folder: Path, array: zarr.Array, *place: int) -> Path:
    """Return the file of a chunk; ``place`` counts chunks along the axes, 0 where it is short."""
    place += (0,) * (len(array.shape) - len(place))
    return folder / array.path / array.metadata.encode_chunk_key(place)


@contextmanager
def reading_chunk(file: Path, words: str, *, needed: bool = True) -> Iterator[None]:
    """Turn what a library says of a damaged chunk, or one missing if ``needed``, into one line."""
    try:
        if file.is_file() and not file.stat().st_size:
            raise ValueError("the file is empty")
        if needed and not file.is_file():
            raise ValueError("there is no such file")
        yield
    except OSError:  # a disk that cannot be read now; it names the file
        raise
    except Exception as error:  # codecs raise many kinds
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{file}: {words}: found it damaged ({reason.rstrip('.')}); the command that wrote it "
            "does so again"
        ) from None


FORMAT, VERSION = "emission-film", 1
SUFFIX = ".zarr"


class VolumeFilm:
    """Volumes of one grid, one a frame, read and written one at a time.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    FileNotFoundError
        If there is nothing at ``path``.
    ValueError
        If it is no film of volumes.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        import zarr  # slow to import

        self.path = Path(path)
        if not self.path.is_dir():
            raise FileNotFoundError(f"{self.path}: no such film of volumes")
        with errors_of_libraries(f"{self.path}: not a readable film of volumes"):
            group = zarr.open_group(self.path, mode="r+", zarr_format=3)
            found = group.attrs.get("format"), group.attrs.get("version")
            if found != (FORMAT, VERSION):
                raise ValueError(f"format: found {found}, expected {(FORMAT, VERSION)}")
            self.grid = VoxelGrid(**cast("dict[str, Any]", group.attrs["grid"]))
            self.length_unit = str(group.attrs["length_unit"])
            self._values = cast("zarr.Array", group["emission"])
            if self._values.shape[1:] != self.grid.shape or self._values.dtype != np.float32:
                raise ValueError(
                    f"emission: found {self._values.dtype} {self._values.shape}, expected "
                    f"float32 (frames, {', '.join(map(str, self.grid.shape))})"
                )
            if self._values.chunks != (1, *self.grid.shape):
                raise ValueError(f"emission: found chunks {self._values.chunks}, expected a frame")
        if not has_checksums(self._values):
            note_without_checksums(self.path)

    def __repr__(self) -> str:
        return f"VolumeFilm({str(self.path)!r})"

    @classmethod
    def create(
        cls,
        path: str | os.PathLike,
        grid: VoxelGrid,
        times: Sequence[float],
        length_unit: str = "mm",
    ) -> VolumeFilm:
        """Make a film without frames; ``times`` are those of its frames in seconds."""
        import zarr

        about = {"format": FORMAT, "version": VERSION, "grid": grid.to_mapping()}
        group = zarr.create_group(
            Path(path), zarr_format=3, attributes=about | {"length_unit": length_unit}
        )
        create_array(
            group, "emission", (len(times), *grid.shape), (1, *grid.shape), "f4",
            ("time", "x", "y", "z"), math.nan, long_name="mean emission of a voxel",
        )  # fmt: skip
        write_coordinates(group, grid, times, length_unit)
        return cls(path)

    @staticmethod
    def is_at(path: str | os.PathLike) -> bool:
        """Return whether a folder is a film of volumes, such as a simulation's truth."""
        try:
            about = json.loads((Path(path) / "zarr.json").read_text("utf-8"))
            return about["attributes"]["format"] == FORMAT
        except (OSError, ValueError, KeyError, TypeError):
            return False

    @property
    def n_frames(self) -> int:
        """Frames that the film is for."""
        return self._values.shape[0]

    def read(self, number: int) -> Volume:
        """Return the volume of a frame, if it is there and sound."""
        if not 0 <= number < self.n_frames:
            raise ValueError(
                f"{self.path}: frame {number}: found {self.n_frames} frames, expected more"
            )
        file = chunk_file(self.path, self._values, number)
        with reading_chunk(file, f"frame {number}"):
            check_claim(4 * self.grid.size, file.stat().st_size)
            volume = np.asarray(self._values[number])
        if not np.isfinite(volume).all():
            raise ValueError(f"{self.path}: frame {number}: found NaN or infinity, expected none")
        return Volume(volume, self.grid, self.length_unit)

    def write(self, number: int, volume: NDArray[np.float32]) -> None:
        """Write the volume of a frame."""
        self._values[number] = volume


def write_coordinates(
    group: zarr.Group,
    grid: VoxelGrid,
    times: Sequence[float],
    length_unit: str,
    time_unit: str = "s",
) -> None:
    """Write the arrays ``time``, ``x``, ``y`` and ``z`` of volumes over time."""
    coordinates = {"time": (np.asarray(times, np.float64), time_unit)}
    coordinates |= {name: (one, length_unit) for name, one in zip("xyz", grid.axes(), strict=True)}
    for name, (values, unit) in coordinates.items():
        array = create_array(group, name, values.shape, values.shape, "f8", (name,), units=unit)
        array[:] = values
