"""The wheel and the source distribution that pip and other people's machines are given."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (
    ".ci", ".gitignore", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE",
    "MANIFEST.in", "README.md", "constraints.txt", "docs", "flametomo.py", "packaging", "phantoms",
    "pyproject.toml", "rigs", "setup.cfg", "tests", "tomo", "tools",
)  # fmt: skip


def build(kind, source, out):
    code = f"from setuptools import build_meta; build_meta.build_{kind}({str(out)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=source, check=True, capture_output=True)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build the source distribution from a copy, and the wheel from it: pip may do the same.

    A copy, since a build leaves files, and those of older ones would be packed.
    """
    folder = tmp_path_factory.mktemp("distribution")
    source, out = folder / "source", folder / "dist"
    for name in SOURCES:
        path = ROOT / name
        if path.is_dir():
            shutil.copytree(path, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            source.mkdir(exist_ok=True)
            shutil.copy(path, source / name)
    out.mkdir()
    build("sdist", source, out)
    (archive,) = out.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    build("wheel", unpacked, out)
    return out


def names_beside(folder, pattern):
    return {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob(pattern)}


def test_the_wheel_holds_the_packages_and_their_data_alone(built):
    (wheel,) = built.glob("*.whl")
    assert wheel.stat().st_size < 5e6
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        texts = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" in name}
    wanted = {"flametomo.py"}
    for folder in ("tomo", "rigs", "phantoms"):
        wanted |= names_beside(folder, "*.py") | {f"{folder}/py.typed"}
    wanted |= names_beside("tomo/draw/templates", "*.html")
    wanted |= names_beside("tomo/draw/templates", "*.js")
    wanted |= names_beside("rigs/presets", "*.yaml")
    wanted |= names_beside("tomo/wernet/settings_files", "*.yaml")
    wanted |= names_beside("tomo/operators/gpu", "*.cu")
    assert names == wanted
    (entry_points,) = (text for name, text in texts.items() if name.endswith("entry_points.txt"))
    assert b"flametomo = tomo.cli:main" in entry_points
    assert any(name.endswith("LICENSE") for name in texts)
    (metadata,) = (text.decode() for name, text in texts.items() if name.endswith("METADATA"))
    assert "License-Expression: BSD-3-Clause\n" in metadata
    assert "Author: The flametomo authors\n" in metadata


def test_the_source_distribution_holds_what_a_checkout_holds(built):
    (archive,) = built.glob("*.tar.gz")
    assert archive.stat().st_size < 10e6
    with tarfile.open(archive) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    for source in SOURCES:
        path = ROOT / source
        wanted = names_beside(source, "*") if path.is_dir() else {source}
        wanted = {n for n in wanted if "__pycache__" not in n and (ROOT / n).is_file()}
        assert wanted
        assert wanted
        assert names >= wanted
    assert names >= {"tests/conftest.py", "docs/rig.png", "tomo/draw/templates/report.html"}
    assert not [name for name in names if name.endswith(".pyc")]


def test_links_and_pictures_of_the_readme_lead_somewhere_in_the_source_distribution(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    targets = re.findall(r"\]\(([^)\s#]+)", (ROOT / "README.md").read_text("utf-8"))
    assert len(targets) > 10
    assert {one for one in targets if not one.startswith("https:")} <= names
