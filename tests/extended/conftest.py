"""Photographs with a known blur."""

import numpy as np
import pytest
from scipy import fft
from skimage import data

MARGIN = 64


def streaked(scene, length, angle, decibels=40.0, seed=1):
    """Blur exactly, cut off what the borders' mirror images reach, and add white noise."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    padded = np.pad(scene.astype(float), MARGIN, mode="symmetric")
    fy, fx = fft.fftfreq(padded.shape[0])[:, None], fft.rfftfreq(padded.shape[1])
    whole = fft.irfft2(fft.rfft2(padded) * np.sinc(length * (c * fx + s * fy)), padded.shape)
    x, y = (MARGIN + int(np.ceil(length / 2 * abs(part))) + 2 for part in (c, s))
    image = whole[y:-y, x:-x]
    return image + np.random.default_rng(seed).normal(0, image.std() * 10 ** (-decibels / 20), image.shape)


@pytest.fixture(scope="session")
def blur():
    return streaked


@pytest.fixture(scope="session")
def gravel():
    """A part of it: a blind fit takes a third of the time."""
    return data.gravel()[:300, :300].astype(float)


@pytest.fixture(scope="session")
def coins():
    return data.coins().astype(float)
