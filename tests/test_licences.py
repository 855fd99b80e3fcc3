"""The page of licences names the packages of constraints.txt, below the extras that need them."""

import re
from configparser import ConfigParser
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROSE, TABLES = (ROOT / "docs/develop/licences.md").read_text("utf-8").split("## All packages\n")
CONFIG = ConfigParser()
CONFIG.read(ROOT / "setup.cfg")
EXTRAS = {"core": CONFIG["options"]["install_requires"], **CONFIG["options.extras_require"]}


def pins(name):
    found = re.findall(r"^([\w.-]+)==(\S+)", (ROOT / name).read_text("utf-8"), re.MULTILINE)
    return {canonicalize_name(package): version for package, version in found}


def rows(text):
    return re.findall(r"^\| (\S+) \| (\S+) \| (.+) \|$", text, re.MULTILINE)


def test_the_page_has_the_pinned_packages_each_once():
    """If it fails, run packaging/licences.py in an environment with all extras."""
    listed = rows(TABLES.replace("| package | version | licence |", ""))
    found = [(canonicalize_name(name), version) for name, version, _ in listed]
    assert sorted(found) == sorted(pins("constraints.txt").items())


@pytest.mark.parametrize("extra", EXTRAS)
def test_what_an_extra_asks_for_stands_under_its_name(extra):
    groups = dict(re.findall(r"^### (.*)\n((?:[^#].*\n|\n)*)", TABLES, re.MULTILINE))
    named = [users for users in groups if {extra, "core"} & set(users.split(", "))]
    there = {name.lower() for users in named for name, *_ in rows(groups[users])}
    wanted = [Requirement(line).name for line in EXTRAS[extra].strip().splitlines()]
    assert {name.lower() for name in wanted} <= there


def test_the_page_says_what_every_copyleft_licence_means():
    copyleft = [name for name, _, licence in rows(TABLES) if re.search("GPL|MPL", licence)]
    assert len(copyleft) > 3
    assert [name for name in copyleft if f"| {name} |" not in PROSE] == []


def test_every_pin_has_hashes_of_the_same_version():
    """If it fails, renew constraints.hashes.txt as docs/develop/releasing.md says."""
    text = (ROOT / "constraints.hashes.txt").read_text("utf-8")
    assert pins("constraints.hashes.txt") == pins("constraints.txt")
    assert not re.findall(r"==\S+\n", text)
    assert len(re.findall(r"--hash=sha256:[0-9a-f]{64}\b", text)) == text.count("--hash")
    assert "://" not in text
