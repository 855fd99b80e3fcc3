"""Settings of both networks and of their training, and the files that hold them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from importlib import resources
from typing import Any, TypeVar

from rigs.files.text import expected_one_of, read_yaml_mapping, shortened

INPUTS = ("absolute", "relative")
VARIANTS = ("no-bias", "bias-mask", "batch-norm")
LOSSES = ("squared", "absolute")

_MOST_BLOCKS, _MOST_CHANNELS = 64, 1024
"""Convolutions of an encoder and their width. More: a file of one line could take all memory.
Fewer: networks that somebody may want to try are refused."""

_SHIPPED = "settings_files"


@dataclass(frozen=True)
class PaperSettings:
    """Network and training of `tomo.wernet.wernet_paper`.

    The defaults are the reading of the paper that works. The text's own figures are
    ``load_settings("paper-text", PaperSettings)``. Both are compared in the results page "The
    WERNet paper, repeated".

    Parameters
    ----------
    inputs : {"relative", "absolute"}
        Six numbers of a segment that the encoder sees. relative: the place in the voxel and the
        ray's direction. absolute, the text's: the voxel's index and the segment's midpoint, with
        which an encoder can hide a smooth factor of the voxels in the weights.
    variant : {"bias-mask", "batch-norm", "no-bias"}
        What stands between a convolution and its Leaky ReLU.
    blocks, channels : int
        Hidden convolutions of a new encoder, and their width.
    last_bias : float or None
        First value of the bias of the last convolution. The weights start near its square. None:
        PyTorch's random one near zero, where a square is flat and training starts slowly.
    normalise_gradient : bool
        Whether a voxel's gradient is divided by the norm of its ray's weights.
    loss : {"squared", "absolute"}
        Mean over the rays of a step of the squared or the absolute error.
    voxel_start : float
        Upper end of the random first voxels, where the brightest pixel is one and a voxel's edge
        is the unit of length. Larger: the first predictions are several times too large, and
        training ends far from the truth. Smaller: training takes longer.
    voxel_learning_rate, encoder_learning_rate : float
        Adam's first learning rates; zero keeps what it belongs to. The text's are 0.01 and
        0.0005. Larger: the loss jumps. Smaller: the halvings end training before it is done.
    halve_every : int
        Epochs between two halvings of both learning rates.
    rays_per_step : int
        Rays in one step of Adam. Fewer: more steps an epoch, each noisier. More: too few steps
        before the learning rates are small. The text has 32 x 100.

    Raises
    ------
    ValueError
        In one line that names the field, what was found and what was expected.
    """

    inputs: str = "relative"
    variant: str = "bias-mask"
    blocks: int = 3
    channels: int = 32
    last_bias: float | None = 0.5
    normalise_gradient: bool = True
    loss: str = "squared"
    voxel_start: float = 0.1
    voxel_learning_rate: float = 0.01
    encoder_learning_rate: float = 0.005
    halve_every: int = 5
    rays_per_step: int = 200

    def __post_init__(self) -> None:
        """Check every field."""
        for name, known in (("inputs", INPUTS), ("variant", VARIANTS), ("loss", LOSSES)):
            _check(self, name, getattr(self, name) in known, f"one of {', '.join(known)}")
        _check_whole(self, "blocks", _MOST_BLOCKS)
        _check_whole(self, "channels", _MOST_CHANNELS)
        _check_whole(self, "halve_every")
        _check_whole(self, "rays_per_step")
        if self.last_bias is not None:
            _check_number(self, "last_bias", -math.inf, math.inf, "a finite number or null")
        is_switch = isinstance(self.normalise_gradient, bool)
        _check(self, "normalise_gradient", is_switch, "true or false")
        for name in ("voxel_start", "voxel_learning_rate", "encoder_learning_rate"):
            _check_number(self, name, 0, math.inf, "a finite number >= 0")


@dataclass(frozen=True)
class WernetSettings:
    """Encoder and training of `tomo.wernet.wernet`.

    Parameters
    ----------
    blocks, channels : int
        Hidden convolutions of a new encoder, and their width.
    steps : int
        Steps of an outer iteration. Fewer: little is learned before voxels are solved for again.
        More: the encoder learns the errors of the present voxels.
    rays_per_step : int
        Rays of a step at most, drawn anew each iteration; where there are few rays, each step has
        its part. Fewer: noisier gradients. More: time.
    penalty : float
        Weight of the mean squared correction against the mean squared relative residual. Smaller:
        a common factor drifts between weights and voxels. Larger: true corrections are shrunk.
    learning_rate : float
        Adam's first learning rate. Larger: corrections overshoot at once. Smaller: the steps of an
        iteration teach too little.
    last_rate : float
        The learning rate falls along half a cosine to this fraction of the first. Larger: the
        last corrections jitter. Smaller: the last steps are wasted.

    Raises
    ------
    ValueError
        In one line that names the field, what was found and what was expected.
    """

    blocks: int = 2
    channels: int = 16
    steps: int = 24
    rays_per_step: int = 3000
    penalty: float = 1e-3
    learning_rate: float = 3e-3
    last_rate: float = 0.02

    def __post_init__(self) -> None:
        """Check every field."""
        _check_whole(self, "blocks", _MOST_BLOCKS)
        _check_whole(self, "channels", _MOST_CHANNELS)
        _check_whole(self, "steps")
        _check_whole(self, "rays_per_step")
        _check_number(self, "penalty", 0, math.inf, "a finite number >= 0")
        _check_number(self, "learning_rate", 0, math.inf, "a finite number >= 0")
        _check_number(self, "last_rate", 0, 1, "a number from 0 to 1")


@dataclass(frozen=True)
class LearningFiles:
    """Files that a training starts from and writes, as a settings file names them.

    Parameters
    ----------
    encoder : str, optional
        The encoder file to start from; a new one by default.
    freeze_encoder : bool
        Whether the encoder is used as it is, without training.
    save_encoder : str, optional
        A file to write the trained encoder to.
    checkpoint : str, optional
        A file in which wernet-paper keeps the state of its training.
    resume : bool
        Whether wernet-paper goes on from the checkpoint where there is one.

    Raises
    ------
    ValueError
        In one line that names the field, what was found and what was expected.
    """

    encoder: str | None = None
    freeze_encoder: bool = False
    save_encoder: str | None = None
    checkpoint: str | None = None
    resume: bool = False

    def __post_init__(self) -> None:
        """Check every field."""
        for name in ("encoder", "save_encoder", "checkpoint"):
            found = getattr(self, name)
            _check(self, name, found is None or (isinstance(found, str) and found != ""), "a path")
        for name in ("freeze_encoder", "resume"):
            _check(self, name, isinstance(getattr(self, name), bool), "true or false")
        if self.freeze_encoder and self.encoder is None:
            raise ValueError(
                "freeze_encoder: found no encoder to freeze, expected encoder as well"
            )
        if self.resume and self.checkpoint is None:
            raise ValueError("resume: found no checkpoint to go on from, expected checkpoint too")


@dataclass(frozen=True)
class Learning:
    """What a settings file says: of the network and its training, and of their files."""

    settings: PaperSettings | WernetSettings
    files: LearningFiles

    @classmethod
    def load(cls, source: str | os.PathLike, method: str) -> Learning:
        """Read a settings file for ``wernet`` or ``wernet-paper``, see `load_settings`.

        Paths in it are relative to its folder. Only wernet-paper keeps checkpoints.
        """
        is_paper = method == "wernet-paper"
        known = [
            field.name
            for field in fields(LearningFiles)
            if is_paper or field.name not in ("checkpoint", "resume")
        ]
        path = _found(source)
        content = read_yaml_mapping(path)
        named = {name: content.pop(name) for name in known if name in content}
        settings: PaperSettings | WernetSettings
        if is_paper:
            settings = _made(PaperSettings, content, path, known)
        else:
            settings = _made(WernetSettings, content, path, known)
        for name, value in named.items():
            if isinstance(value, str) and value:
                named[name] = os.path.join(os.path.dirname(path), value)
        return cls(settings, _made(LearningFiles, named, path))

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of a solver for it, but for ``save_encoder``."""
        files = {field.name: getattr(self.files, field.name) for field in fields(self.files)}
        files.pop("save_encoder")
        return {"settings": self.settings, **files}


Kind = TypeVar("Kind", PaperSettings, WernetSettings, LearningFiles)


def settings_names() -> tuple[str, ...]:
    """Return the names of the settings that come with the package."""
    return tuple(sorted(f.name.removesuffix(".yaml") for f in _shipped() if _is_yaml(f)))


def load_settings(source: str | os.PathLike, kind: type[Kind]) -> Kind:
    """Return the settings in a YAML file, whose fields are those of the kind.

    Fields that the file leaves out keep their defaults.

    Parameters
    ----------
    source : path or str
        A file, or one of `settings_names`.
    kind : type
        `PaperSettings` or `WernetSettings`.

    Raises
    ------
    FileNotFoundError
        If there is neither; the line lists the names.
    ValueError
        In one line that names the file and the field, for a field that is unknown, of another
        type, out of range or not finite.

    Examples
    --------
    >>> load_settings("paper-text", PaperSettings).rays_per_step
    3200
    """
    path = _found(source)
    return _made(kind, read_yaml_mapping(path), path)


def _found(source: str | os.PathLike) -> str:
    """Return the path of a settings file, or of one that comes with the package."""
    for file in _shipped():
        if file.name == f"{source}.yaml":
            return str(file)
    if not os.path.exists(source):
        known = ", ".join(settings_names())
        raise FileNotFoundError(
            f"{source}: no such settings file, and none that comes along; those are {known}"
        )
    return os.fspath(source)


def _made(
    kind: type[Kind], found: Mapping[str, Any], path: str, others: Sequence[str] = ()
) -> Kind:
    types: dict[str, str] = {field.name: str(field.type) for field in fields(kind)}
    for name in found:
        if name not in types:
            raise ValueError(
                f"{path}: {shortened(name)}: found a field that {kind.__name__} has not, "
                f"{expected_one_of(str(name), (*types, *others))}"
            )
    try:
        return kind(**{name: _number_of(value, types[name]) for name, value in found.items()})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _number_of(value: Any, type_name: str) -> Any:
    """Return the number where one was read as text: to YAML, 1e-3 is text and 1.0e-3 a number."""
    if isinstance(value, str) and type_name.startswith("float"):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def _check_whole(settings: object, name: str, most: float = math.inf) -> None:
    found = getattr(settings, name)
    is_whole = isinstance(found, int) and not isinstance(found, bool)
    range_ = ">= 1" if most == math.inf else f"from 1 to {most}"
    _check(settings, name, is_whole and 1 <= found <= most, f"a whole number {range_}")


def _check_number(settings: object, name: str, lower: float, upper: float, expected: str) -> None:
    found = getattr(settings, name)
    is_number = isinstance(found, (int, float)) and not isinstance(found, bool)
    is_good = is_number and math.isfinite(found) and lower <= found <= upper
    _check(settings, name, is_good, expected)


def _check(settings: object, name: str, good: bool, expected: str) -> None:
    if not good:
        found = getattr(settings, name)
        raise ValueError(f"{name}: found {shortened(found)}, expected {expected}")


def _shipped() -> list[Any]:
    return list((resources.files("tomo.wernet") / _SHIPPED).iterdir())


def _is_yaml(file: Any) -> bool:
    return file.name.endswith(".yaml")
