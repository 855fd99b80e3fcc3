"""Columns of effects in arrays of other libraries: those of NumPy's."""

import numpy as np
import pytest

from tomo.inference.columns import OwnColumns, SharedColumns

PTR = np.array([0, 30, 30, 37, 90])  # the second view has no pixel
PARAMETERS, VIEWS = 3, len(PTR) - 1

pytest.importorskip("array_api_compat")


@pytest.fixture(params=["torch", "array_api_strict"])
def there(request):
    """Return a function that copies an array to another library."""
    library = pytest.importorskip(request.param)
    return lambda values: library.asarray(np.array(values))


def alike(found, expected):
    np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("count", [PARAMETERS, 0])
def test_columns_of_views_and_of_all_are_those_of_numpy(there, count):
    random = np.random.default_rng(0)
    values, pixels = random.normal(size=(count, PTR[-1])), random.normal(size=PTR[-1])
    weights = random.uniform(0.5, 2, PTR[-1])
    own, other = (OwnColumns(values, PTR, one) for one in (weights, there(weights)))
    parameters = random.normal(size=(count, VIEWS))
    if count:
        alike(other.forward(parameters), own.forward(parameters))
    alike(other.adjoint(there(pixels)), own.adjoint(pixels))
    alike(other.gram(), own.gram())
    shared, common = (SharedColumns(values, one) for one in (weights, there(weights)))
    alike(common.added(there(pixels), parameters[:, 0]), shared.added(pixels, parameters[:, 0]))
    alike(common.adjoint(there(pixels)), shared.adjoint(pixels))
    alike(common.gram(), shared.gram())


def test_a_pixel_has_the_columns_of_its_own_view():
    values = np.random.default_rng(1).normal(size=(PARAMETERS, PTR[-1]))
    own = OwnColumns(values, PTR, np.ones(PTR[-1]))
    parameters = np.zeros((PARAMETERS, VIEWS))
    parameters[1, 2] = 2.0
    expected = np.zeros(PTR[-1])
    expected[30:37] = 2.0 * values[1, 30:37]
    np.testing.assert_allclose(own.forward(parameters), expected)
    assert own.adjoint(expected)[0, 2] == pytest.approx(values[0, 30:37] @ expected[30:37])
