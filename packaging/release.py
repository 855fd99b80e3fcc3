"""Checks, builds, tries and tags a release: ``python packaging/release.py [--tag]``.

It stops with one line and exit code 2 where the tree has changes, where the four files do not have
the same version, or where the day is missing. The distributions are built from what git knows, in
a folder of their own; in each Python that is found, both are installed into an empty environment,
which then runs the demo. ``--page`` and ``--file`` make the links of README.md absolute in the
distributions, as an index of packages needs them::

    python packaging/release.py --tag \
        --page 'https://example.org/flametomo/blob/{tag}/{path}' \
        --file 'https://example.org/flametomo/raw/{tag}/{path}'
"""

from __future__ import annotations

import argparse
import io
import logging
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from configparser import ConfigParser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?://|#)([^)#\s]+)(#[^)]*)?\)")
PYTHONS = ("python3.11", "python3.12", "python3.13")
DAY = r"\d{4}-\d{2}-\d{2}"

log = logging.getLogger("release")


def version_of(root: Path) -> str:
    """Return the version in setup.cfg."""
    config = ConfigParser()
    config.read(root / "setup.cfg", encoding="utf-8")
    return config["metadata"]["version"]


def faults(root: Path, version: str) -> list[str]:
    """Return a line for each file that lacks the version or the day of the release."""
    wanted = {
        "CITATION.cff": (f"version: {version}", f"date-released: '?\"?{DAY}"),
        "CHANGELOG.md": (rf"## \[{re.escape(version)}\] - {DAY}",),
        "packaging/conda/recipe.yaml": (f'version: "{version}"',),
    }
    return [
        f"{name}: found no line {pattern!r}"
        for name, patterns in wanted.items()
        for pattern in patterns
        if not re.search(rf"^\s*{pattern}", (root / name).read_text("utf-8"), re.MULTILINE)
    ]


def absolute(text: str, page: str, file: str, tag: str) -> str:
    """Return Markdown whose links to files of the project are addresses.

    Parameters
    ----------
    text
        The page, with links relative to the project's root.
    page, file
        Addresses with ``{tag}`` and ``{path}``: of a file shown as a page, for links; of the file
        itself, for pictures.
    tag
        The tag of the release.
    """

    def replaced(link: re.Match) -> str:
        picture, words, path, place = link.groups("")
        address = (file if picture else page).format(tag=tag, path=path)
        return f"{picture}[{words}]({address}{place})"

    return LINK.sub(replaced, text)


def build(folder: Path, page: str | None, file: str | None, tag: str) -> list[Path]:
    """Build wheel and source distribution of HEAD in build/dist; return their paths."""
    with tarfile.open(fileobj=io.BytesIO(_output("git", "archive", "HEAD"))) as tree:
        tree.extractall(folder, filter="data")
    if page and file:
        readme = folder / "README.md"
        readme.write_text(absolute(readme.read_text("utf-8"), page, file, tag), "utf-8")
    else:
        log.warning("README.md: links stay relative; --page and --file make them absolute")
    target = ROOT / "build/dist"
    shutil.rmtree(target, ignore_errors=True)
    _run(sys.executable, "-m", "build", "--outdir", str(target), str(folder))
    made = sorted(target.iterdir())
    _run(sys.executable, "-m", "twine", "check", "--strict", *map(str, made))
    return made


def try_out(python: str, distributions: list[Path]) -> None:
    """Install each distribution into an empty environment, and run the demo in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        _run(python, "-m", "venv", f"{folder}/venv")
        pip = (f"{folder}/venv/bin/python", "-m", "pip", "install", "-q")
        command = f"{folder}/venv/bin/flametomo"
        for distribution in distributions:
            again = ("--no-deps", "--force-reinstall") if Path(command).exists() else ()
            _run(*pip, *again, "-c", str(ROOT / "constraints.txt"), str(distribution))
            _run(command, "--version", cwd=folder)
        _run(command, "demo", "-o", "demo", cwd=folder)
        if not list(Path(folder, "demo").rglob("report.html")):
            _stop(f"{python}: the demo wrote no report.html")


def main() -> None:
    """Do all steps, or stop at the first that fails."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tag", action="store_true", help="make the tag when all has passed")
    parser.add_argument("--page", help="address of a page, with {tag} and {path}")
    parser.add_argument("--file", help="address of a file, with {tag} and {path}")
    parser.add_argument("--python", action="append", help="an interpreter; may be repeated")
    asked = parser.parse_args()
    version = version_of(ROOT)
    tag = f"v{version}"
    if _output("git", "status", "--short"):
        _stop("the tree has changes that are not committed; a release is what git knows")
    if asked.tag and _output("git", "tag", "--list", tag):
        _stop(f"the tag {tag} is there already; write the next version in setup.cfg")
    if found := faults(ROOT, version):
        for line in found:
            (_stop if asked.tag else log.warning)(line)
    pythons = asked.python or [name for name in PYTHONS if shutil.which(name)]
    with tempfile.TemporaryDirectory() as folder:
        distributions = build(Path(folder), asked.page, asked.file, tag)
    for python in pythons:
        try_out(python, distributions)
    log.info("%s: both distributions work in %s", version, ", ".join(pythons))
    if asked.tag:
        _run("git", "tag", "-a", tag, "-m", f"flametomo {version}")
        log.info("tagged %s; upload build/dist with twine, and push the tag", tag)


def _run(*command: str, cwd: str | Path = ROOT) -> None:
    log.info("> %s", " ".join(command))
    environment = {**os.environ, "PYTHONPATH": ""}
    if subprocess.run(command, cwd=cwd, env=environment, check=False).returncode:
        _stop(f"failed: {' '.join(command)}")


def _output(*command: str) -> bytes:
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout


def _stop(line: str) -> None:
    log.error("error: %s", line)
    sys.exit(2)


if __name__ == "__main__":
    main()
