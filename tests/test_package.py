import ast
import re
import subprocess
import sys
import tomllib
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("phantoms", "rigs", "tomo")
HEAVY = ("torch", "open3d", "matplotlib", "plotly", "numba", "cv2", "trimesh", "scipy", "pydantic")

# DESIGN: imports point down this list of floors, never up. What no floor names is on the top one.
FLOORS = [
    {"rigs"},
    {
        "tomo.grid",
        "tomo._bricks",
        "tomo._by_name",
        "tomo._clearance",
        "tomo._compile",
        "tomo._groups",
        "tomo._inner_product",
        "tomo._kernel_compiler",
        "tomo._memory",
        "tomo._numbering",
        "tomo._lanes",
        "tomo._lines",
        "tomo._row_sum",
        "tomo._spoiled",
        "tomo._sums",
        "tomo._threads",
        "tomo._waiting",
        "tomo.metrics",
        "tomo.noise",
    },
    {"phantoms", "tomo._pinhole", "tomo.io", "tomo.live_voxels"},
    {"tomo.rays", "tomo.segments"},
    {"tomo.trace", "tomo._visible"},
    {
        "tomo._blur",
        "tomo._coarser",
        "tomo._pixels_of_sources",
        "tomo.defocus",
        "tomo._products",
        "tomo.linear_system",
        "tomo.on_the_fly",
        "tomo.projector",
        "tomo.smooth_basis",
        "tomo.splines",
        "tomo.support",
        "tomo.viewed",
    },
    {
        "tomo.alignment",
        "tomo.displacement",
        "tomo.registration",
        "tomo._gains",
        "tomo.gains",
        "tomo.reconstruction",
        "tomo.solve",
        "tomo.suspects",
        "tomo.wernet",
    },
    {"tomo.condition"},
    {"tomo.refine"},
    {"tomo.corrections", "tomo.scan", "tomo.scan_file", "tomo._scan_schema"},
    {"tomo.simulate", "tomo.reconstruct", "tomo.view"},
]


def in_fresh_interpreter(code):
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout


def test_importing_the_packages_loads_nothing_heavy():
    code = f"import sys, {', '.join(PACKAGES)}; print(*sys.modules)"
    loaded = {name.split(".")[0] for name in in_fresh_interpreter(code).split()}
    assert loaded >= set(PACKAGES)
    assert not loaded & set(HEAVY)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_resolves(package):
    code = f"import {package} as p\nfor name in p.__all__: print(name, getattr(p, name) is None)"
    lines = in_fresh_interpreter(code).splitlines()
    assert lines
    assert all(line.endswith("False") for line in lines)


def modules():
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            yield ".".join(part for part in parts if part != "__init__"), path


def imported(path, module):
    """Return the modules of the toolkit that a file imports, at its top or in a function.

    What stands under ``if TYPE_CHECKING`` is no import: it is there for the reader.
    """
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            node.body = []
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import, expected an absolute one"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in found if name.split(".")[0] in PACKAGES}


PUBLIC_HOME = {  # names that `tomo` hands out from its modules
    "tomo.Projector": "tomo.projector",
    "tomo.Rays": "tomo.rays",
    "tomo.Reconstruction": "tomo.reconstruction",
    "tomo.Scan": "tomo.scan",
    "tomo.Segments": "tomo.segments",
    "tomo.VoxelGrid": "tomo.grid",
    "tomo.dot_test": "tomo.projector",
}


def floor(name):
    name = PUBLIC_HOME.get(name, name)
    for number, members in enumerate(FLOORS):
        for member in members:
            if name == member or name.startswith(member + "."):
                return number, member
    return len(FLOORS) - 1, name


def test_imports_point_down():
    upward = []
    for module, path in modules():
        here, home = floor(module)
        for name in imported(path, module):
            there, target = floor(name)
            if there > here and home != target:
                upward.append(f"{module} imports {name}")
    assert not upward


def test_the_check_of_imports_can_fail(tmp_path):
    source = tmp_path / "m.py"
    source.write_text("def f():\n    from tomo.solve import cgls\n")
    assert imported(source, "tomo.grid") == {"tomo.solve.cgls"}
    assert floor("tomo.solve.cgls")[0] > floor("tomo.grid")[0]


def test_the_packages_that_stand_alone():
    for module, path in modules():
        names = imported(path, module)
        if module.split(".")[0] == "rigs":
            assert not [n for n in names if not n.startswith("rigs")], module
        if module.split(".")[0] == "phantoms":
            strangers = [n for n in names if not n.startswith(("phantoms", "tomo.grid"))]
            assert set(strangers) <= {"tomo.VoxelGrid"}, module


def requirements():
    config = ConfigParser()
    config.read(ROOT / "setup.cfg")
    listed = config["options"]["install_requires"] + config["options.extras_require"]["dev"]
    return [line for line in listed.splitlines() if line.strip()]


DISTRIBUTIONS = {
    "cv2": "opencv-contrib-python-headless",
    "lazy_loader": "lazy-loader",
    "nrrd": "pynrrd",
    "skimage": "scikit-image",
    "yaml": "pyyaml",
}


def test_what_is_imported_is_required():
    """What only comes along with another dependency may stay away with its next release."""
    used = set()
    tools = sorted((ROOT / "tools").glob("*.py"))
    files = [path for _, path in modules()] + tools
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                used |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                used.add(node.module.split(".")[0])
    own = (path.stem for path in (ROOT / "tools").iterdir())
    used -= {*sys.stdlib_module_names, *PACKAGES, *own}
    wanted = {re.match(r"[\w.-]+", line).group().lower() for line in requirements()}
    assert {DISTRIBUTIONS.get(name, name) for name in used} <= wanted


def test_constraints_pin_every_dependency():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    pins = {name.lower().replace("_", "-"): version for name, version in pins.items()}
    wanted = {re.match(r"[\w.-]+", line).group().lower() for line in requirements()}
    assert len(wanted) > 15
    assert wanted <= set(pins)
    assert pins["torch"] == "2.13.0"


def test_constraints_satisfy_the_lower_bounds():
    from packaging.requirements import Requirement

    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    pins = {name.lower(): version for name, version in pins.items()}
    for line in requirements():
        requirement = Requirement(line)
        assert requirement.specifier.contains(pins[requirement.name.lower()]), line


def test_the_project_files_are_well_formed():
    with (ROOT / "pyproject.toml").open("rb") as file:
        assert tomllib.load(file)["build-system"]["build-backend"] == "setuptools.build_meta"
    assert "BSD 3-Clause" in (ROOT / "LICENSE").read_text()
