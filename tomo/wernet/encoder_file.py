"""Encoders in files: settings and numbers, never code."""

from __future__ import annotations

import pickletools
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, overload

import torch

from rigs.files import atomic_path
from rigs.files.size_guard import check_claim, errors_of_libraries
from tomo.wernet.default.correction import CorrectionEncoder
from tomo.wernet.paper.encoder import WeightEncoder

_FORMAT, _VERSION = "wernet-encoder", 2
Encoder = WeightEncoder | CorrectionEncoder
Kind = TypeVar("Kind", bound=Encoder)

_KINDS: dict[str, type[Encoder]] = {"weights": WeightEncoder, "correction": CorrectionEncoder}
"""The paper's encoder, which gives weights, and the default one, which corrects lengths."""

_TENSOR_PARTS = (
    "torch._utils _rebuild_tensor_v2",
    "torch FloatStorage",
    "torch DoubleStorage",
    "torch ByteStorage",
    "collections OrderedDict",
)
"""Names in the pickle of a file of float tensors and the state of a generator; no others are
accepted."""


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
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise ValueError(f"{path}: format: found no {_FORMAT!r}, expected an encoder")
    if content.get("version") != _VERSION:
        raise ValueError(f"{path}: version: found {content.get('version')!r}, expected {_VERSION}")
    with errors_of_libraries(f"{path}: found an encoder that does not fit its settings"):
        encoder = rebuilt(_KINDS[content["kind"]], content["settings"], content["state"])
    if kind is not None and not isinstance(encoder, kind):
        raise ValueError(
            f"{path}: kind: found an encoder of {content['kind']}, expected one of "
            + next(name for name, of in _KINDS.items() if of is kind)
        )
    return encoder


def rebuilt(
    kind: type[Kind], settings: Mapping[str, Any], state: Mapping[str, torch.Tensor]
) -> Kind:
    """Return the encoder of settings and tensors that were read from a file.

    Raises
    ------
    Exception
        Several kinds: the two do not fit each other, or a number is not finite.
    """
    # Settings are checked against the numbers before an encoder of their size is allocated.
    blocks, channels = settings["blocks"], settings["channels"]
    numbers = sum(tensor.numel() for tensor in state.values())
    if blocks > len(state) or 3 * channels * (1 + (blocks - 1) * channels) > numbers:
        raise ValueError(f"blocks, channels: found {blocks}, {channels} with {numbers} numbers")
    encoder = kind(**settings)
    encoder.load_state_dict(state)
    for name, tensor in encoder.state_dict().items():
        if not tensor.isfinite().all():
            raise ValueError(f"{name}: NaN or infinity")
    return encoder


def load_tensors(path: Path, expected: str) -> object:
    """Return the content of a file of tensors and plain values; anything else is refused.

    Raises
    ------
    ValueError
        If it cannot be read; the message names the ``expected`` content.
    """
    try:
        with zipfile.ZipFile(path) as archive:  # torch.save writes zip archives
            members = archive.infolist()
            size = sum(item.file_size for item in members)
            check_claim(size, path.stat().st_size)
            for item in members:
                if item.filename.endswith("data.pkl"):
                    _check_names(archive.read(item))
        content = torch.load(path, map_location="cpu", weights_only=True)
        _check_tensors(content)
    except Exception as error:  # torch raises half a dozen kinds for a file it cannot read
        raise ValueError(
            f"{path}: found a file that cannot be read, expected {expected}"
        ) from error
    return content


def _check_names(pickled: bytes) -> None:
    """Raise if a pickle names anything but the parts of tensors.

    Torch itself calls no other code, but it allocates a bytearray of any length.
    """
    for operation, argument, _ in pickletools.genops(pickled):
        if "GLOBAL" in operation.name and argument not in _TENSOR_PARTS:
            raise ValueError(f"found {argument}, expected tensors and plain values")


def _check_tensors(content: object) -> None:
    """Raise if a tensor claims more numbers than the file stores for it."""
    waiting, seen = [content], set()
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, Mapping):
            waiting += item.values()
        elif isinstance(item, list | tuple | set):
            waiting += item
        elif isinstance(item, torch.Tensor):
            held = item.untyped_storage().nbytes() if item.layout == torch.strided else -1
            if item.numel() * item.element_size() > held:
                raise ValueError("found a tensor of more numbers than are stored")
