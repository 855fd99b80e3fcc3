"""Write the tables of docs/develop/licences.md: packages, licences, and who needs them.

    .venv/bin/python packaging/licences.py

Run it in an environment that holds all extras. A package that is not installed, such as open3d
where open3d-cpu serves, keeps the licence that the page gives to the same version.
"""

import configparser
import re
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name as key

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/develop/licences.md"
SYSTEMS = [
    {"sys_platform": system, "platform_system": name, "python_version": version,
     "python_full_version": f"{version}.9", "platform_machine": machine}
    for system, name, machine in (
        ("linux", "Linux", "x86_64"), ("darwin", "Darwin", "arm64"), ("win32", "Windows", "AMD64")
    )
    for version in ("3.11", "3.12", "3.13")
]  # fmt: skip
ROW = re.compile(r"^\| (\S+) \| (\S+) \| (.+) \|$", re.MULTILINE)


def licence_of(fields: metadata.PackageMetadata) -> str | None:
    """Return the licence that a package's metadata state, or None where they state none."""
    short = (fields.get("License") or "").strip()
    classifiers = [
        line.split(" :: ")[-1]
        for line in fields.get_all("Classifier", [])
        if line.startswith("License :: ")
    ]
    if len(short.splitlines()) > 1 or short == "UNKNOWN":  # the whole text stands in the field
        short = ""
    return fields.get("License-Expression") or ", ".join(classifiers) or short or None


def closure(lines: list[str], pins: dict) -> set[str]:
    """Return the pinned packages that requirements need on any of SYSTEMS, theirs included."""
    found, todo = set(), [Requirement(line) for line in lines]
    while todo:
        wanted = todo.pop()
        name = key(wanted.name)
        if (name, *sorted(wanted.extras)) in found or name not in pins:
            continue
        found.add((name, *sorted(wanted.extras)))
        try:
            needs = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        for need in map(Requirement, needs):
            extras = wanted.extras or {""}
            if need.marker is None or any(
                need.marker.evaluate({**system, "extra": extra})
                for system in SYSTEMS
                for extra in extras
            ):
                todo.append(need)
    return {name for name, *_ in found}


def tables(text: str, setup: str, old: str) -> str:
    """Return the tables: a heading for each set of extras, its packages below.

    Parameters
    ----------
    text, setup, old
        constraints.txt, setup.cfg and the page as it is.
    """
    pins = {key(n): (n, v) for n, v in re.findall(r"^([\w.-]+)==(.+)$", text, re.MULTILINE)}
    kept = {(name, version): licence for name, version, licence in ROW.findall(old)}
    config = configparser.ConfigParser()
    config.read_string(setup)
    needs = {"core": config["options"]["install_requires"], **config["options.extras_require"]}
    needs = {extra: closure(lines.split("\n")[1:], pins) for extra, lines in needs.items()}
    groups = {}
    for name, (spelt, version) in pins.items():
        users = [extra for extra, packages in needs.items() if name in packages]
        users = users[:1] if users[:1] == ["core"] else users
        try:
            licence = licence_of(metadata.metadata(name))
        except metadata.PackageNotFoundError:
            licence = kept.get((spelt, version))
        if licence is None:
            raise SystemExit(f"{spelt} {version}: found no licence; install it, or add its row")
        groups.setdefault(", ".join(users), []).append(f"| {spelt} | {version} | {licence} |")
    order = sorted(groups, key=lambda users: (users != "core", users == "", users.split(", ")))
    return "\n\n".join(
        f"### {users or 'Not needed'}\n\n| package | version | licence |\n|---|---|---|\n"
        + "\n".join(groups[users])
        for users in order
    )


if __name__ == "__main__":
    old = PAGE.read_text("utf-8")
    head = old.split("\n### ")[0]
    files = [(ROOT / name).read_text("utf-8") for name in ("constraints.txt", "setup.cfg")]
    PAGE.write_text(f"{head}\n{tables(*files, old)}\n", "utf-8")
