"""Arrays of Zarr groups whose chunks carry checksums, and the line on a chunk that is damaged."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import DTypeLike

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
    """Make an array whose chunks end in the CRC-32C of their compressed bytes.

    A chunk that holds nothing but the fill value is written like any other: a chunk that is
    missing was never written, or was lost.
    """
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
    """Turn what a library says of a damaged chunk into one line that names file and frame.

    Parameters
    ----------
    file : Path
        The chunk's.
    words : str
        What it holds, such as ``"frame 3"``.
    needed : bool
        Whether a missing file is damage; else it stands for values that were never written.

    Raises
    ------
    ValueError
        If the chunk is missing, empty, truncated or has other bits than were written.
    OSError
        If the disk cannot read it.
    """
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
