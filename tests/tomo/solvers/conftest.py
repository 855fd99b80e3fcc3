import pytest


@pytest.fixture(autouse=True, scope="module")
def _one_thread(on_threads):
    """Run small kernels on one thread: waiting for a second costs more, most of all when busy."""
    with on_threads(1):
        yield
