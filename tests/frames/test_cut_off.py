"""Cores of stars that are cut off at a level which no header states, and tops that are not."""

import numpy as np
import pytest

from jitterkit.frames import Metadata, RawFrame
from jitterkit.frames.cut_off import with_cut_off

Y, X = np.mgrid[:48, :48]


def star(peak, sigma=2.0, x=23.3, y=24.1, seed=1, gain=2.0):
    """ADU of a star on a sky of 100 ADU, with noise unless the seed is None."""
    light = 100 + peak * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2 * sigma**2))
    if seed is None:
        return np.rint(light)
    return np.rint(np.random.default_rng(seed).poisson(light * gain) / gain)


COMPUTED = star(3000, x=23.5, y=23.5, seed=None) + 0.3
COMPUTED -= np.where(COMPUTED.max() > COMPUTED, 1e-12 * np.random.default_rng(3).random((48, 48)), 0.0)
"""Symmetric but for rounding, as poppy's PSF between four pixels."""


def level(data, mask=None, **known):
    raw = RawFrame(data.astype(float), mask=mask, metadata=Metadata().override("header X", **known))
    found = with_cut_off(raw).metadata
    return found.value("saturation"), found.warnings


@pytest.mark.parametrize("cut", [400, 1500, 2300])
@pytest.mark.parametrize("scale", [1.0, 3.7, 1 / 65535])
def test_a_core_that_is_cut_off_gives_the_level(cut, scale):
    unit = "electron" if scale == 3.7 else "adu"
    found, warnings = level(np.minimum(star(3000), cut) * scale, unit=unit, saturation=65535.0)
    assert found == cut * scale
    (warning,) = warnings
    assert f"{found:g}" in warning


@pytest.mark.parametrize(
    ("data", "saturation"),
    [
        (star(3000), 65535.0),
        (np.minimum(star(3000), 1500), 1500.0),  # known already
        (star(3000, x=23.5, y=23.5, seed=None), 65535.0),  # four equal pixels by symmetry
        (COMPUTED, 65535.0),
        (COMPUTED.astype(np.float32), 65535.0),
        (star(20, sigma=8, seed=None), 65535.0),  # a top that is flat between two numbers
        (np.full((48, 48), 65535.0), 1e6),
        (np.random.default_rng(2).poisson(0.4, (48, 48)).astype(float), 65535.0),
    ],
    ids=["whole", "known", "symmetric", "computed", "computed in 32 bits", "coarse", "even", "few photons"],
)
def test_a_top_that_is_not_cut_off_or_known_to_be_is_left(data, saturation):
    assert level(data, saturation=saturation) == (saturation, ())


def test_noise_cuts_nothing_off():
    found = [level(star(peak, sigma, seed=k))[0] for k in range(200) for peak, sigma in ((5, 3), (60, 3))]
    assert found == [None] * 400


def test_masked_pixels_and_rates_are_no_core():
    data = np.minimum(star(3000), 1500)
    assert level(data, mask=data == 1500)[0] is None
    assert level(data, unit="adu/s")[0] is None


def test_a_level_that_the_user_gives_stays():
    raw = RawFrame(np.minimum(star(3000), 1500), metadata=Metadata().override("command line", saturation=4e3))
    assert with_cut_off(raw) is raw
