"""Encoders in files: settings and numbers, never code."""

from __future__ import annotations

import pickletools
import zipfile
from pathlib import Path
from typing import Any, TypeVar, overload

import torch

from rigs.files import atomic_path
from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import check_plain_file
from tomo.wernet.default.encoder import CorrectionEncoder
from tomo.wernet.paper.encoder import WeightEncoder

_FORMAT, _VERSION = "wernet-encoder", 3
Encoder = WeightEncoder | CorrectionEncoder
Kind = TypeVar("Kind", bound=Encoder)

_KINDS: dict[str, type[Encoder]] = {"weights": WeightEncoder, "correction": CorrectionEncoder}
"""The paper's encoder, which gives weights, and the default one, which corrects lengths."""

_TENSOR_PARTS = {
    "torch._utils _rebuild_tensor_v2", "torch FloatStorage", "torch DoubleStorage",
    "torch ByteStorage", "collections OrderedDict",
}  # fmt: skip
"""Names in the pickle of float tensors and the state of a generator. Of the few others that torch
accepts, one is given memory of any length."""


def save_encoder(encoder: Encoder, path: str | Path) -> None:
    """Write an encoder with its settings to ``path`` (``.pt``), for `load_encoder`.

    Parameters
    ----------
    encoder : CorrectionEncoder or WeightEncoder
        ``Solution.encoder`` of `wernet` or `wernet_paper`.
    path : path or str
        An existing file is replaced once the new one is complete.
    """
    kind = next(name for name, of in _KINDS.items() if isinstance(encoder, of))
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "kind": kind,
        "settings": encoder.settings,
        "state": {name: value.cpu() for name, value in encoder.state_dict().items()},
    }
    with atomic_path(path) as temporary:
        torch.save(content, temporary)


@overload
def load_encoder(path: str | Path, kind: None = None) -> Encoder: ...
@overload
def load_encoder(path: str | Path, kind: type[Kind]) -> Kind: ...
def load_encoder(path: str | Path, kind: type[Kind] | None = None) -> Encoder | Kind:
    """Read an encoder that `save_encoder` wrote; code in the file is never run.

    Parameters
    ----------
    path : path or str
    kind : type, optional
        `CorrectionEncoder` or `WeightEncoder`; either when None.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not an encoder, or one of another version or kind.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file, expected an encoder that save_encoder wrote"
        )
    content = load_tensors(path, "an encoder written by save_encoder")
    if content.get("format") != _FORMAT:
        raise ValueError(f"{path}: format: found no {_FORMAT!r}, expected an encoder")
    if content.get("version") != _VERSION:
        raise ValueError(f"{path}: version: found {content.get('version')!r}, expected {_VERSION}")
    with errors_of_libraries(f"{path}: found an encoder that does not fit its settings"):
        settings, state = content["settings"], content["state"]
        # Settings are checked against the file before an encoder of their size is allocated.
        blocks, channels = settings["blocks"], settings["channels"]
        numbers = 3 * channels * (1 + (blocks - 1) * channels)
        if blocks > len(state) or 4 * numbers > path.stat().st_size:
            raise ValueError(f"blocks, channels: found {blocks}, {channels} in so small a file")
        encoder = _KINDS[content["kind"]](**settings)
        encoder.load_state_dict(state)  # names and shapes are the encoder's, or it is refused
        for name, tensor in encoder.state_dict().items():
            if not tensor.isfinite().all():
                raise ValueError(f"{name}: NaN or infinity")
    if kind is not None and not isinstance(encoder, kind):
        raise ValueError(
            f"{path}: kind: found an encoder of {content['kind']}, expected one of "
            + next(name for name, of in _KINDS.items() if of is kind)
        )
    return encoder


def load_tensors(path: Path, expected: str) -> dict[str, Any]:
    """Return the mapping of tensors and plain values in a file; anything else is refused.

    Raises
    ------
    ValueError
        If it cannot be read; the message names the ``expected`` content.
    """
    check_plain_file(path)
    try:
        with zipfile.ZipFile(path) as archive:  # torch.save writes zip archives
            members = archive.infolist()
            check_claim(sum(one.file_size for one in members), path.stat().st_size)
            for member in members:
                data = archive.read(member)  # raises at a wrong checksum, which torch ignores
                if member.filename.endswith("data.pkl"):
                    _check_names(data)
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises half a dozen kinds for a file it cannot read
        raise ValueError(
            f"{path}: found a file that cannot be read, expected {expected}"
        ) from error
    return content if isinstance(content, dict) else {}


def _check_names(pickled: bytes) -> None:
    """Raise if a pickle names anything but the parts of tensors."""
    for operation, argument, _ in pickletools.genops(pickled):
        if "GLOBAL" in operation.name and argument not in _TENSOR_PARTS:
            raise ValueError(f"found {argument}, expected tensors and plain values")
