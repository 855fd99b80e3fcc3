"""The examples of the gallery: what happens around each, and how long each took."""

import json
import shutil
import sys
from pathlib import Path

from .stage import BUILD

LONGEST = 20  # seconds on two cores that an example may take: a reader runs it, and every build


def forget_files(gallery: dict, script: str) -> None:
    """Remove the files that an example wrote: it runs in the folder of the staged examples."""
    for path in Path(gallery["examples_dirs"]).iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.suffix not in (".py", ".rst"):
            path.unlink()


def seconds() -> dict[str, float]:
    """Return the seconds that each example took when it was last run, the longest first."""
    costs = (BUILD / "source/gallery").glob("*.cost.json")
    found = {path.name.split(".")[0]: json.loads(path.read_text())["time"] for path in costs}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


if __name__ == "__main__":
    for name, took in seconds().items():
        note = f"  more than {LONGEST} s" if took > LONGEST else ""
        sys.stderr.write(f"{took:7.1f} s  {name}{note}\n")
