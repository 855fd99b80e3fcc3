"""What other programs read of the project: its metadata, citation, conda recipe and Dockerfile."""

import importlib.util
import re
import shutil
import tomllib
from configparser import ConfigParser
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ConfigParser()
CONFIG.read(ROOT / "setup.cfg")
METADATA = CONFIG["metadata"]
DOCKERFILE = (ROOT / "packaging" / "Dockerfile").read_text("utf-8")
RECIPE = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))

SPEC = importlib.util.spec_from_file_location("release", ROOT / "packaging" / "release.py")
release = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(release)

# Names of a distribution on conda-forge, where they differ from pip's
ON_CONDA_FORGE = {
    "lazy-loader": "lazy_loader",
    "matplotlib": "matplotlib-base",
    "open3d-cpu": "open3d",
    "opencv-contrib-python-headless": "opencv",
    "torch": "pytorch",
}


def lines(text):
    return [line.strip() for line in text.splitlines() if line.strip()]


def test_the_version_stands_everywhere_as_in_setup_cfg():
    version = METADATA["version"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == version
    assert RECIPE["context"]["version"] == version
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")
    with (ROOT / "pyproject.toml").open("rb") as file:
        assert "project" not in tomllib.load(file)  # a second place for metadata


def test_the_citation_has_what_the_format_asks_for():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation.keys() >= {"message", "title", "authors"}  # the format's required keys
    assert citation["type"] == "software"
    assert citation["license"] == METADATA["license_expression"]
    assert [one["name"] for one in citation["authors"]] == [METADATA["author"]]
    assert METADATA["author"] in (ROOT / "LICENSE").read_text("utf-8")
    assert set(citation["keywords"]) <= set(re.split(r",\s*", METADATA["keywords"]))


def test_classifiers_say_what_python_requires():
    classifiers = lines(METADATA["classifiers"])
    assert classifiers == sorted(classifiers)
    versions = re.findall(r"Python :: 3\.(\d+)", METADATA["classifiers"])
    assert CONFIG["options"]["python_requires"] == f">=3.{versions[0]}"
    assert "Typing :: Typed" in classifiers
    assert not [one for one in classifiers if one.startswith("License")]  # SPDX says it


def test_the_conda_recipe_asks_for_what_setup_cfg_asks_for():
    wanted = {f"python {CONFIG['options']['python_requires']}"}
    for line in lines(CONFIG["options"]["install_requires"]):
        requirement = Requirement(line)
        name = requirement.name.lower()
        wanted.add(f"{ON_CONDA_FORGE.get(name, name)} {requirement.specifier}")
    run = RECIPE["requirements"]["run"]
    assert len(run) == len(set(run))
    assert set(run) == wanted
    with (ROOT / "pyproject.toml").open("rb") as file:
        backend = Requirement(tomllib.load(file)["build-system"]["requires"][0])
    assert f"{backend.name} {backend.specifier}" in RECIPE["requirements"]["host"]


def test_the_conda_recipe_names_the_project_as_setup_cfg_does():
    assert RECIPE["package"]["name"] == METADATA["name"]
    assert RECIPE["about"]["summary"] == METADATA["description"]
    assert RECIPE["about"]["license"] == METADATA["license_expression"]
    assert (ROOT / RECIPE["about"]["license_file"]).is_file()
    assert RECIPE["build"]["noarch"] == "python"
    scripts = lines(CONFIG["options.entry_points"]["console_scripts"])
    assert RECIPE["build"]["python"]["entry_points"] == scripts
    imports = RECIPE["tests"][0]["python"]["imports"]
    assert {f"{name}*" for name in imports} == set(
        lines(CONFIG["options.packages.find"]["include"])
    )


def instructions():
    """Return the instructions of the Dockerfile, continued lines joined, as (name, rest)."""
    text = re.sub(r"^#.*\n", "", DOCKERFILE, flags=re.MULTILINE)
    text = re.sub(r"\\\n\s*", " ", text)
    return [tuple(line.split(maxsplit=1)) for line in lines(text)]


def test_the_image_is_built_on_one_named_release():
    bases = [rest.split()[0] for name, rest in instructions() if name == "FROM"]
    assert len(bases) == 2
    assert len(set(bases)) == 1  # compiled code moves from one stage to the other
    (tag,) = {base.partition(":")[2] for base in bases}
    assert re.fullmatch(r"3\.11\.\d+-slim-[a-z]+", tag)


def last_stage():
    steps = instructions()
    start = max(i for i, (name, _) in enumerate(steps) if name == "FROM")
    return steps[start:]


def test_the_image_runs_the_command_as_a_user_without_rights():
    steps = last_stage()
    named = {name: rest for name, rest in steps}  # of repeated ones the last, as Docker does
    assert named["USER"] not in ("root", "0")
    assert f"useradd --create-home --uid 1000 {named['USER']}" in DOCKERFILE
    assert named["ENTRYPOINT"] == '["flametomo"]'
    assert named["VOLUME"] == named["WORKDIR"] == "/data"
    order = [name for name, _ in steps]
    assert order.index("USER") > max(i for i, name in enumerate(order) if name == "RUN")


def test_the_image_holds_no_lists_of_packages_and_no_compilers():
    for name, rest in instructions():
        if name == "RUN" and "apt-get" in rest:
            assert "--no-install-recommends" in rest
            assert rest.endswith("rm -rf /var/lib/apt/lists/*")
        if name == "RUN" and "pip install" in rest:
            assert "--no-cache-dir -c constraints.txt" in rest
    text = " ".join(rest for _, rest in last_stage())
    assert "pip install" not in text
    assert not re.search(r"\b(gcc|build-essential|g\+\+|dev)\b", text)


def test_the_image_has_the_libraries_that_the_scripts_look_for():
    """tools/_setup.sh knows the libraries of Open3D by the Debian packages that hold them."""
    setup = (ROOT / "tools" / "_setup.sh").read_text("utf-8")
    packages = re.findall(r'"lib[^"]+\.so\.\d+": "([^"]+)"', setup)
    assert len(packages) == 5
    installed = next(rest for name, rest in last_stage() if "apt-get" in rest)
    assert set(packages) == set(re.findall(r"\blib[\w.-]+", installed)) - {"lib"}


@pytest.mark.parametrize("name", ["setup.cfg", "pyproject.toml", "constraints.txt", "LICENSE"])
def test_the_context_of_the_image_holds_what_pip_reads(name):
    text = (ROOT / "packaging" / "Dockerfile.dockerignore").read_text("utf-8")
    kept = {line[1:] for line in lines(text) if line.startswith("!")}
    assert name in kept
    assert all((ROOT / one).exists() for one in kept)
    assert kept >= {"README.md", "flametomo.py", "tomo", "rigs", "phantoms"}


def test_an_index_of_packages_gets_absolute_links():
    text = (ROOT / "README.md").read_text("utf-8")
    found = release.absolute(text, "https://a.org/{tag}/{path}", "https://f.org/{path}", "v1")
    targets = re.findall(r"\]\(([^)]*)\)", found)
    assert len(targets) > 20
    assert all(one.startswith(("https://", "#")) for one in targets)
    assert "](https://f.org/docs/flame.gif)" in found
    assert re.search(r"\]\(https://a\.org/v1/docs/results/\w+\.md#[\w-]+\)", found)
    for path in re.findall(r"https://(?:a\.org/v1|f\.org)/([^)#]*)", found):
        assert (ROOT / path).exists()


def test_a_release_needs_its_version_and_its_day_in_all_files(tmp_path):
    names = ("CITATION.cff", "CHANGELOG.md", "packaging/conda/recipe.yaml")
    (tmp_path / "packaging/conda").mkdir(parents=True)
    for name in names:
        shutil.copy(ROOT / name, tmp_path / name)
    version = METADATA["version"]
    for name, old, new in (
        ("CHANGELOG.md", f"[{version}] - unreleased", f"[{version}] - 2026-12-01"),
        ("CITATION.cff", "license:", "date-released: 2026-12-01\nlicense:"),
    ):
        text = (tmp_path / name).read_text("utf-8")
        (tmp_path / name).write_text(text.replace(old, new), "utf-8")
    assert release.faults(tmp_path, version) == []
    lines_found = release.faults(tmp_path, "9.9.9")
    assert {line.partition(":")[0] for line in lines_found} == set(names)
