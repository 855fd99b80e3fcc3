"""A device that runs threads in any order; a CUDA device where there is one."""

import pytest

from tomo.operators.gpu import CudaDevice, DeviceError


@pytest.fixture(scope="session")
def shuffled(host):
    """Return one that runs threads in an order drawn by chance."""
    return type(host)(host.libraries, order=7)


@pytest.fixture(scope="session")
def cuda():
    """Return a CUDA device, or skip with what is missing."""
    try:
        return CudaDevice()
    except DeviceError as error:
        pytest.skip(str(error))
