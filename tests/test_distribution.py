"""The wheel and the source distribution that pip and other people's machines are given."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (
    "setup.cfg", "pyproject.toml", "README.md", "LICENSE", "tomo", "rigs", "phantoms", "tests",
)  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build both from a copy: a build leaves files, and those of older ones would be packed."""
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
    for kind in ("sdist", "wheel"):
        code = f"from setuptools import build_meta; build_meta.build_{kind}('../dist')"
        subprocess.run([sys.executable, "-c", code], cwd=source, check=True, capture_output=True)
    return out


def names_beside(folder, pattern):
    return {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob(pattern)}


def test_the_wheel_holds_the_packages_and_their_data_alone(built):
    (wheel,) = built.glob("*.whl")
    assert wheel.stat().st_size < 5e6
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        texts = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" in name}
    wanted = set()
    for folder in ("tomo", "rigs", "phantoms"):
        wanted |= names_beside(folder, "*.py") | {f"{folder}/py.typed"}
    wanted |= names_beside("tomo/draw/templates", "*.html") | names_beside(
        "rigs/presets", "*.yaml"
    )
    assert names == wanted
    (entry_points,) = (text for name, text in texts.items() if name.endswith("entry_points.txt"))
    assert b"flametomo = tomo.cli:main" in entry_points
    assert any(name.endswith("LICENSE") for name in texts)


def test_the_source_distribution_can_be_built_from(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    assert names >= {"setup.cfg", "pyproject.toml", "README.md", "LICENSE", "tomo/cli/app.py"}
    assert names >= {"tomo/py.typed", "tomo/draw/templates/report.html"}
    assert names >= names_beside("rigs/presets", "*.yaml")
