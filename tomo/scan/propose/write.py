"""scan.yaml and rig.yaml of a proposal, with comments that say where everything comes from."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from rigs import save_rig
from rigs.files import whole_folder
from rigs.progress import printable
from tomo.scan.propose.contents import KINDS, RIG_FILE, THUMBNAILS
from tomo.scan.propose.proposal import Proposal
from tomo.scan.write import SCAN_FILE

WRITTEN = (SCAN_FILE, RIG_FILE, THUMBNAILS)
"""The files that a proposal is written to."""

_HINTS = {
    "dark": "dark: dark/{camera}        # a folder of frames with caps on, an image or a number",
    "flat": "flat: flat/{camera}        # images of even light, dark taken off",
    "bit_depth": "bit_depth: 12             # where the camera does not fill its integers",
}
"""Lines to take for corrections that are not there."""


def write_proposal(
    proposal: Proposal, pictures: Mapping[str, bytes] | None = None, *, force: bool = False
) -> Path:
    """Write a proposal and further pictures into its folder, all or nothing; return its scan.yaml.

    What is there is overwritten by ``force`` alone, the rig that the proposal keeps not at all.
    """
    pictures = pictures or {}
    others = pictures if proposal.rig is None else (RIG_FILE, *pictures)
    check_writable(proposal.folder, others, force=force)
    with whole_folder(proposal.folder, last=(SCAN_FILE,)) as staging:
        if proposal.rig is not None:
            save_rig(proposal.rig, staging / RIG_FILE)
            text = (staging / RIG_FILE).read_text("utf-8")
            head = _comment(("Written by flametomo init", *proposal.said["rig"]))
            (staging / RIG_FILE).write_text(head + text, "utf-8")
        for name, content in pictures.items():
            (staging / name).write_bytes(content)
        (staging / SCAN_FILE).write_text(scan_text(proposal), "utf-8")
    return proposal.folder / SCAN_FILE


def check_writable(folder: Path, others: Iterable[str] = (), *, force: bool) -> None:
    """Raise if scan.yaml or one of some other files is there, unless it may be overwritten."""
    for name in (SCAN_FILE, *others):
        if (folder / name).exists() and not force:
            raise FileExistsError(
                f"{folder / name}: found a file, expected none; force=True overwrites it"
            )


def scan_text(proposal: Proposal) -> str:
    """Return the scan.yaml of a proposal."""
    said, scan, images = proposal.said, proposal.scan, proposal.images
    entries: list[tuple[Iterable[str], dict[str, Any]]] = [
        (
            ("Written by flametomo init from the files in this folder; change what does not fit",),
            {"format": "emission-scan", "version": 1},
        ),
        (said["rig"], {"rig": RIG_FILE}),
        (said["grid"], {"grid": _plain_grid(proposal)}),
    ]
    folder = proposal.folder
    if images.films:
        films = {name: _inside(film.path, folder) for name, film in images.films.items()}
        found: dict[str, Any] = {"films": films}
    elif images.is_pattern_enough:
        found = {"images": images.pattern}
    else:
        frames = [
            {
                "name": frame.name,
                "images": {name: _inside(one, folder) for name, one in frame.images.items()},
            }
            for frame in scan.frames
        ]
        found = {"frames": frames}
    entries.append((said["images"], found))
    text = "".join(_comment(lines) + _yaml(content) for lines, content in entries)
    return text + _corrections(proposal)


def _corrections(proposal: Proposal) -> str:
    """Return the block of corrections; what is not there is a comment to take."""
    has_some = bool(proposal.corrections)
    text = "corrections:\n" if has_some else "# corrections:\n"
    for name in (*KINDS, "bit_depth", "bayer", "channel"):
        lines = proposal.said.get(name, [])
        if name in proposal.corrections:
            text += textwrap.indent(_comment(lines), "  ")
            text += textwrap.indent(_yaml({name: proposal.corrections[name]}), "  ")
        elif name in _HINTS:
            note = f" ({'; '.join(lines)})" if lines else ""
            hint = f"#   {_HINTS[name]}{note}"
            text += f"  # {hint[4:]}\n" if has_some else f"{hint}\n"
    return text


def _plain_grid(proposal: Proposal) -> dict[str, Any]:
    grid = proposal.grid.to_mapping()
    x, y, z = grid["spacing"]
    return {**grid, "spacing": x} if x == y == z else grid


def _inside(path: object, folder: Path) -> str:
    return Path(str(path)).relative_to(folder).as_posix()


def _yaml(content: dict[str, Any]) -> str:
    """Return lines of YAML; values of a mapping stand on one line, frames on their own."""
    text = ""
    for name, value in content.items():
        settings: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "width": 2**30}
        if isinstance(value, dict) and name != "films":
            inside = yaml.safe_dump(value, default_flow_style=True, **settings)
            text += f"{name}: {inside}"
        else:
            text += yaml.safe_dump({name: value}, default_flow_style=False, **settings)
    return text


def _comment(lines: Iterable[str]) -> str:
    """Return lines as comments of at most 100 characters."""
    return "".join(
        f"# {part}\n"
        for line in lines
        for part in textwrap.wrap(" ".join(printable(line).split()), 98, subsequent_indent="  ")
    )
