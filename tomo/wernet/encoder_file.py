"""Encoders in files: what it takes to build one, and its numbers; never code."""

from __future__ import annotations

from pathlib import Path

import torch

from tomo.io.atomic import atomic_path
from tomo.wernet.correction import CorrectionEncoder
from tomo.wernet.encoder import WeightEncoder

_FORMAT, _VERSION = "wernet-encoder", 2
_KINDS = {"weights": WeightEncoder, "correction": CorrectionEncoder}
"""The paper's encoder, which gives weights, and the default one, which corrects chord lengths."""

SHIPPED = Path(__file__).parent / "encoders"

Encoder = WeightEncoder | CorrectionEncoder


def shipped_encoders() -> tuple[str, ...]:
    """Return the names of the encoders that come with the package."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.pt")))


def save_encoder(encoder: Encoder, path: str | Path) -> None:
    """Write an encoder, with what it takes to build it again, to ``path`` (``.pt``)."""
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


def load_encoder(path: str | Path, kind: type[Encoder] | None = None) -> Encoder:
    """Read an encoder that `save_encoder` wrote; code in the file is never run.

    Parameters
    ----------
    path : path or str
        A file, or the name of one of `shipped_encoders`.
    kind : type, optional
        Refuse encoders of other kinds.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not an encoder, is one of another version, or of another kind.
    """
    if str(path) in shipped_encoders():
        path = SHIPPED / f"{path}.pt"
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file, expected an encoder, or one of the names "
            f"{', '.join(shipped_encoders()) or '(none)'}"
        )
    content = load_tensors(path, "an encoder written by save_encoder")
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise ValueError(f"{path}: format: found no {_FORMAT!r}, expected an encoder")
    if content.get("version") != _VERSION:
        raise ValueError(f"{path}: version: found {content.get('version')!r}, expected {_VERSION}")
    try:
        encoder = _KINDS[content["kind"]](**content["settings"])
        encoder.load_state_dict(content["state"])
        for name, numbers in encoder.state_dict().items():
            if not numbers.isfinite().all():
                raise ValueError(f"{name}: NaN or infinity")
    except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        reason = str(error).splitlines()[0]
        raise ValueError(f"{path}: found an encoder that does not fit itself: {reason}") from error
    if kind is not None and not isinstance(encoder, kind):
        raise ValueError(
            f"{path}: kind: found an encoder of {content['kind']}, expected one of "
            + next(name for name, of in _KINDS.items() if of is kind)
        )
    return encoder


def load_tensors(path: Path, expected: str) -> object:
    """Return what a file of tensors and plain values holds; anything else is refused.

    Raises
    ------
    ValueError
        If it cannot be read; the message says what was ``expected``.
    """
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises half a dozen kinds for a file it cannot read
        raise ValueError(
            f"{path}: found a file that cannot be read ({type(error).__name__}), "
            f"expected {expected}"
        ) from error
