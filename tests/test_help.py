"""What `help`, `dir` and a wrong name say of the packages."""

import doctest

import pytest

import flametomo
import phantoms
import rigs
import tomo
from tomo._compute.higher import HIGHER, higher

PACKAGES = (flametomo, phantoms, rigs, tomo)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_the_example_of_the_docstring_holds(package):
    found = doctest.testmod(package)
    assert found.attempted >= 4
    assert found.failed == 0


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_dir_shows_the_public_names_alone(package):
    assert sorted(dir(package)) == sorted(package.__all__)
    assert not [name for name in dir(package) if name.startswith("_")]


@pytest.mark.parametrize("package", PACKAGES[1:], ids=lambda package: package.__name__)
def test_the_docstring_names_most_of_what_there_is(package):
    named = [name for name in package.__all__ if name in package.__doc__]
    assert len(named) >= 0.5 * len(package.__all__)


def test_a_wrong_name_is_answered_with_the_right_one():
    with pytest.raises(AttributeError, match=r"tomo has no 'reconstuct': did you mean reconstr"):
        tomo.reconstuct  # noqa: B018
    with pytest.raises(AttributeError, match=r"rigs has no 'zzz': help\(rigs\) says"):
        rigs.zzz  # noqa: B018
    with pytest.raises(AttributeError, match="phantoms attribute zzz"):
        phantoms.zzz  # noqa: B018
    with pytest.raises(AttributeError, match=r"rigs.fuzz is not loaded yet|rigs has no 'fuzz'"):
        rigs.fuzz  # noqa: B018
    with pytest.raises(AttributeError, match="flametomo has no 'VoxelGird': did you mean VoxelGr"):
        flametomo.VoxelGird  # noqa: B018
    assert not hasattr(tomo, "__wrapped__")


def test_one_module_has_the_public_names_of_the_three_packages():
    for package in (rigs, phantoms, tomo):
        for name in set(package.__all__) - {"Volume"}:
            assert getattr(flametomo, name) is getattr(package, name)
    assert flametomo.Volume is tomo.Volume


@pytest.mark.parametrize("name", HIGHER)
def test_methods_find_what_they_ask_of_higher_floors(name):
    assert callable(higher(name))
