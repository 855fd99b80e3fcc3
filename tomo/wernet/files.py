"""Encoders and the state of a training in files: tensors and plain values, never code."""

from __future__ import annotations

import copy
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from rigs.files import atomic_path
from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import check_plain_file
from tomo.wernet.encoder import Encoder

_ENCODER, _TRAINING = ("wernet-encoder", 4), ("wernet-training", 1)


def save_encoder(encoder: Encoder, path: str | Path) -> None:
    """Write an encoder with its settings to ``path`` (``.pt``), for `load_encoder`.

    It is ``Solution.encoder`` of `wernet` or `wernet_paper`. An existing file is replaced once
    the new one is complete.
    """
    state = {name: value.cpu() for name, value in encoder.state_dict().items()}
    _save(path, _ENCODER, {"settings": encoder.settings, "state": state})


def load_encoder(path: str | Path) -> Encoder:
    """Read an encoder that `save_encoder` wrote; code in the file is never run.

    Parameters
    ----------
    path : path or str

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not an encoder, or one of another version.
    """
    path = Path(path)
    content = _load(path, _ENCODER, "an encoder that save_encoder wrote")
    with errors_of_libraries(f"{path}: found an encoder that does not fit its settings"):
        settings, state = content["settings"], content["state"]
        # Settings are checked against the file before an encoder of their size is allocated.
        blocks, channels = settings["blocks"], settings["channels"]
        numbers = 3 * channels * (1 + (blocks - 1) * channels)
        if blocks > len(state) or 4 * numbers > path.stat().st_size:
            raise ValueError(f"blocks, channels: found {blocks}, {channels} in so small a file")
        encoder = Encoder(**settings)
        encoder.load_state_dict(state)  # names and shapes are the encoder's, or it is refused
        for name, tensor in encoder.state_dict().items():
            if not tensor.isfinite().all():
                raise ValueError(f"{name}: NaN or infinity")
    return encoder


def own_copy(given: str | Path | Encoder, inputs: Sequence[str]) -> Encoder:
    """Return a copy of an encoder in memory, or of a file, that sees one of the ``inputs``."""
    encoder = copy.deepcopy(given) if isinstance(given, Encoder) else load_encoder(given)
    if encoder.inputs not in inputs:
        where = "" if isinstance(given, Encoder) else f"{given}: "
        raise ValueError(
            f"{where}encoder: found one that sees {encoder.inputs!r} inputs, expected "
            f"{' or '.join(map(repr, inputs))}: it was trained by another method"
        )
    return encoder


def save_training(path: str | Path, problem: str, state: Mapping[str, Any]) -> None:
    """Write the state of a training; the file keeps the one before until this is complete.

    ``problem`` says what it is the training of: images, rays and settings.
    """
    _save(path, _TRAINING, {"problem": problem, "state": dict(state)})


def load_training(path: str | Path, problem: str) -> dict[str, Any] | None:
    """Return the state of a training of this problem; None where there is no file yet."""
    path = Path(path)
    if not path.exists():
        return None
    content = _load(path, _TRAINING, "the state of a training")
    if content.get("problem") != problem or not isinstance(content.get("state"), dict):
        raise ValueError(
            f"{path}: problem: found a training of other images, rays or settings, expected the "
            "one that was interrupted"
        )
    return content["state"]


def _save(path: str | Path, kind: tuple[str, int], content: Mapping[str, Any]) -> None:
    with atomic_path(path, durable=True) as temporary:
        torch.save({"format": kind[0], "version": kind[1], **content}, temporary)


def _load(path: Path, kind: tuple[str, int], expected: str) -> dict[str, Any]:
    """Return the mapping of tensors and plain values in a file of a kind, or refuse the file."""
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file, expected {expected}")
    if path.is_dir():
        raise ValueError(f"{path}: found a folder, expected {expected}")
    check_plain_file(path)
    try:
        with zipfile.ZipFile(path) as archive:  # torch.save writes zip archives
            check_claim(sum(one.file_size for one in archive.infolist()), path.stat().st_size)
            if archive.testzip() is not None:  # a wrong checksum, which torch ignores
                raise ValueError("a part is damaged")
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises half a dozen kinds for a file it cannot read
        raise ValueError(
            f"{path}: found a file that cannot be read, expected {expected}"
        ) from error
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else None
    if found != kind:
        raise ValueError(
            f"{path}: format, version: found {found}, expected {kind}: {expected} by this version"
        )
    return content
