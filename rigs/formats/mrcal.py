"""mrcal's ``.cameramodel``: a Python dictionary of literals, one camera a file.

Read only; a folder of them is a rig, its cameras named by the files. ``lensmodel`` (``lens_model``
and ``distortion_model`` in older files), ``intrinsics``: fx fy cx cy and the lens's coefficients;
``extrinsics``: rotation vector and translation, ``x_cam = R @ x_reference + t``; ``imagersize``:
width and height. Pixel centres are at integers; the files name no unit. Known are
LENSMODEL_PINHOLE and LENSMODEL_OPENCV4, 5, 8 and 12, which are OpenCV's lenses with that many
coefficients.
http://mrcal.secretsauce.net/cameramodels.html, http://mrcal.secretsauce.net/lensmodels.html
"""

from __future__ import annotations

import ast
import re
import warnings
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import read_text, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._lens import from_vector
from rigs.formats._values import as_array, as_mapping, as_size, cameras_of, errors_of, required
from rigs.geometry.rotation import matrix_of_vector
from rigs.rig import Rig

_SUFFIX = ".cameramodel"
_MODEL = ("lensmodel", "lens_model", "distortion_model")
#: Coefficients of each lens, under its name without LENSMODEL_ or, in older files, DISTORTION_.
_COUNTS = {"PINHOLE": 0, "NONE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder, is a ``.cameramodel``."""
    if path.is_dir():
        return bool(_files_of(path))
    return path.suffix == _SUFFIX or bool(
        re.search(r"""^[ \t]*+['"](?:lens_?model|distortion_model)['"]\s*:""", head, re.MULTILINE)
        and re.search(r"""['"]imagersize['"]""", head)
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``.cameramodel`` or of a folder of them."""
    cameras = cameras_of(path, _files_of, _camera, f"*{_SUFFIX} in it, expected one a camera")
    return Rig(cameras, UNKNOWN, "mrcal's reference axes")


def _files_of(folder: Path) -> list[Path]:
    """Return the models in a folder."""
    return sorted(file for file in folder.iterdir() if file.suffix == _SUFFIX and file.is_file())


def _literal(text: str) -> dict[str, Any]:
    """Return the dictionary of literals that a text is; nothing in it is run."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SyntaxWarning of odd escapes
            data = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError) as error:
        line = getattr(error, "lineno", None)
        where = f" at line {line}" if line else ""
        reason = getattr(error, "msg", None) or "it is no dictionary of plain values"
        raise ValueError(f"broken camera model{where}: {reason}") from None
    except (RecursionError, MemoryError):
        raise ValueError("broken camera model: nested too deeply") from None
    return as_mapping(data, "camera model")


def _camera(file: Path) -> Camera:
    """Return the camera of a file."""
    text = read_text(file)
    with errors_of(f"camera {file.stem}"):
        entry = _literal(text)
        key = next((key for key in _MODEL if key in entry), _MODEL[0])
        model = required(entry, key)
        kind = re.sub("^(LENSMODEL|DISTORTION)_", "", model) if isinstance(model, str) else model
        if not isinstance(kind, str) or kind not in _COUNTS:
            known = ", ".join(f"LENSMODEL_{name}" for name in _COUNTS if name != "NONE")
            raise ValueError(
                f"{key}: found {shortened(model)}, expected one of {known}: "
                "mrcal-convert-lensmodel fits one of them"
            )
        values = as_array(required(entry, "intrinsics"), (4 + _COUNTS[kind],), "intrinsics")
        distortion = from_vector(values[4:], False, "intrinsics")
        pose = as_array(required(entry, "extrinsics"), (6,), "extrinsics")
        size = as_size(required(entry, "imagersize"), "imagersize")
        fx, fy, cx, cy = values[:4].tolist()
        K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
        R = matrix_of_vector(pose[:3])
    return Camera(file.stem, size, K, distortion, R, pose[3:], status="calibrated")
