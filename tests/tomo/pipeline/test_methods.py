import numpy as np
import pytest

from tomo import solvers
from tomo.pipeline.methods import method_named, method_names


@pytest.mark.parametrize("name", solvers.METHODS)
def test_a_name_leads_to_its_solver(name):
    method = method_named(name)
    assert method.name == name
    assert method.solver is getattr(solvers, name)
    assert not method.needs_midpoints


@pytest.mark.parametrize("name", ["", "SIRT", "wernet_paper", "METHODS", "__doc__", "stopping"])
def test_other_names_are_refused_with_those_there_are(name):
    with pytest.raises(ValueError, match=r"^method: found ") as error:
        method_named(name)
    assert repr(name) in str(error.value)
    assert all(known in str(error.value) for known in method_names())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", solvers.METHODS)
def test_a_solver_is_given_only_what_it_takes(name, projector_2x2):
    arguments = method_named(name).arguments(device="cpu", seed=7, iterations=3)
    assert arguments["iterations"] == 3
    assert ("seed" in arguments) == (name in ("art", "mart"))
    found = method_named(name).solver(projector_2x2, np.ones(2), **arguments)
    assert found.settings["iterations"] == 3
    assert found.settings["method"] == name
    assert found.settings.get("seed", 7) == 7


@pytest.fixture
def projector_2x2():
    from tomo.grid import VoxelGrid
    from tomo.operators import Projector
    from tomo.trace import Segments

    segments = Segments(np.arange(3), np.arange(2, dtype=np.int32), np.ones(2, np.float32))
    return Projector(segments, VoxelGrid((2, 1, 1), 1.0))
