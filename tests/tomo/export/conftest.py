import pytest


@pytest.fixture(scope="session")
def store(film_store):
    return film_store
