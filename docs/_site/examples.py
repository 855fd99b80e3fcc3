"""What happens around each example of the gallery."""

from pathlib import Path


def forget_files(gallery: dict, script: str) -> None:
    """Remove the files that an example wrote: it runs in the folder of the staged examples."""
    folder = Path(gallery["src_dir"]) / gallery["examples_dirs"]
    for path in folder.iterdir():
        if path.suffix not in (".py", ".rst"):
            _remove(path)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        for inner in path.iterdir():
            _remove(inner)
        path.rmdir()
    else:
        path.unlink()
