"""Images of lenses and of poses in folders of their own, as Pose2Sim has them."""

from __future__ import annotations

from pathlib import Path

_LENSES, _POSES = "intri", "extri"
_BY_PATTERN = "; cameras are called alike by --pattern, like '*_{camera}_img/{frame}.*'"


def check_not_split(folder: Path, are_lenses_given: bool = False) -> None:
    """Raise where a folder holds, or is one of, two folders of images for lenses and for poses.

    Images of a lens alone show the target at other times than those of another camera, so that
    equal names mean no moment: calibrated as one set, they fail after minutes.

    Parameters
    ----------
    folder : pathlib.Path
        The folder to be calibrated from.
    are_lenses_given : bool
        Whether lenses, or images of them, are given too: then a folder of poses alone is right.

    Raises
    ------
    ValueError
        In one line that gives both folders and the option for each.
    """
    if not folder.is_dir():
        return
    lenses, poses = _named(folder, _LENSES), _named(folder, _POSES)
    is_one = folder.name.lower().startswith((_LENSES, _POSES)) and not are_lenses_given
    if is_one and not (lenses and poses):
        lenses, poses = (_named(folder.absolute().parent, name) for name in (_LENSES, _POSES))
    if lenses is None or poses is None:
        return
    cameras = [{path.name for path in one.iterdir() if path.is_dir()} for one in (lenses, poses)]
    alike = "" if cameras[0] == cameras[1] else _BY_PATTERN
    raise ValueError(
        f"{folder}: found images of lenses in {lenses.name} and of poses in {poses.name}, "
        f"expected each as what it is: {poses} as IMAGES and --intrinsics-images {lenses}{alike}"
    )


def _named(folder: Path, start: str) -> Path | None:
    """Return the folder in ``folder`` whose name begins so, if it is one alone."""
    found = [p for p in folder.iterdir() if p.name.lower().startswith(start) and p.is_dir()]
    return found[0] if len(found) == 1 else None
