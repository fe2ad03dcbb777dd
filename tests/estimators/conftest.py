"""Optics without aberrations to fit: what is tested is the blur."""

import pytest


@pytest.fixture(scope="session")
def otf(plain_otf):
    return plain_otf
