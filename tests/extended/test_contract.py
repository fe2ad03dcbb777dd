"""What every blind method must do; a new one is held to it by being in the registry."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended import BLIND
from jitterkit.loci import Linear

TOLERANCE = {"cepstrum": (1.0, 1.5)}
"""Length [pixels] and angle [deg]; half a pixel and a degree, but the cepstrum's peak is a pixel wide."""

NO_STREAK = {"blind": ErrorCode.MODEL_MISMATCH}
"""Of a sharp image: most methods find no mark of a streak, one finds its best streak contradicted."""


def turned(found, expected):
    return (found - expected + 90) % 180 - 90


@pytest.mark.parametrize("name", BLIND)
@pytest.mark.parametrize(("length", "angle"), [(23.4, 20.0), (17.2, 160.0)])
def test_a_known_streak_is_found_with_its_angle_counted_from_x_towards_larger_rows(
    name, length, angle, blur, gravel
):
    estimate = BLIND[name](blur(gravel, length, angle))
    found = estimate.locus.describe()
    along, around = TOLERANCE.get(name, (0.5, 1.0))
    assert found["length"] == pytest.approx(length, abs=along)
    assert abs(turned(found["angle"], angle)) < around
    assert isinstance(estimate.locus, Linear)
    assert estimate.method == name
    # the moments are those of a line: L²/12 along it, nothing across
    n = np.array([np.cos(np.radians(found["angle"])), np.sin(np.radians(found["angle"]))])
    expected = found["length"] ** 2 / 12 * np.array([n[0] ** 2, n[0] * n[1], n[1] ** 2])
    np.testing.assert_allclose(estimate.moments, expected, rtol=1e-9)


@pytest.mark.parametrize("name", BLIND)
def test_turning_the_array_by_a_right_angle_turns_the_answer(name, blur, gravel):
    image = blur(gravel, 20.0, 30.0)
    one, two = (BLIND[name](a).locus.describe() for a in (image, np.rot90(image)))
    # the maximum is sought in steps of 0.25 pixels and 0.5 degrees where it is not refined
    assert two["length"] == pytest.approx(one["length"], abs=0.3)
    assert abs(turned(two["angle"], one["angle"] + 90)) < 0.6


@pytest.mark.parametrize("name", BLIND)
def test_neither_a_factor_nor_an_offset_of_the_light_matters(name, blur, gravel):
    image = blur(gravel, 20.0, 30.0)
    one, two = (BLIND[name](a).moments for a in (image, 37.0 * image + 5000.0))
    # single precision of the power, 1e-7, through a search that stops at 1e-3 of a pixel
    np.testing.assert_allclose(two, one, rtol=2e-3, atol=1e-2)


@pytest.mark.parametrize("name", BLIND)
def test_the_plate_scale_turns_pixels_into_arcsec(name, blur, gravel):
    image = blur(gravel, 20.0, 30.0)
    one, two = (BLIND[name](image, plate_scale=scale) for scale in (1.0, 0.25))
    np.testing.assert_allclose(two.moments, one.moments / 16, rtol=1e-9)
    np.testing.assert_allclose(two.covariance, one.covariance / 256, rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(one.covariance) > 0)


@pytest.mark.parametrize("name", BLIND)
@pytest.mark.parametrize("kind", ["noise", "sharp", "constant", "small"])
def test_what_holds_no_streak_is_refused_in_one_sentence(name, kind, blur, gravel, coins):
    image = {
        "noise": np.random.default_rng(2).normal(100, 5, (256, 256)),
        "sharp": coins,
        "constant": np.full((128, 128), 7.0),
        "small": blur(gravel, 1.8, 25.0),
    }[kind]
    code = {
        "noise": ErrorCode.NO_SIGNAL,
        "constant": ErrorCode.NO_SIGNAL,
        "sharp": NO_STREAK.get(name, ErrorCode.NOT_CONSTRAINED),
        "small": ErrorCode.NOT_CONSTRAINED,
    }[kind]
    values = {"noise": [0.16], "constant": [7]}.get(kind, [])  # the least share of the band; the light
    with refused(code, *values, error=UndeterminedError) as caught:
        BLIND[name](image)
    message = str(caught.value)
    assert message.endswith(".")
    assert ". " not in message


@pytest.mark.parametrize("name", BLIND)
@pytest.mark.parametrize(
    ("image", "code", "values"),
    [
        (np.zeros((40, 300)), ErrorCode.TOO_FEW, ["64 pixels", (40, 300)]),
        (np.zeros((3, 100, 100)), ErrorCode.WRONG_SHAPE, ["(ny, nx)", (3, 100, 100)]),
        (np.full((100, 100), "a"), ErrorCode.WRONG_TYPE, ["<U1"]),
        (np.where(np.eye(100), np.nan, 1.0), ErrorCode.OUT_OF_RANGE, ["100 of", 10000]),
    ],
    ids=["small", "colour", "text", "nan"],
)
def test_bad_input_is_refused_with_the_remedy(name, image, code, values):
    with refused(code, *values, error=ConfigurationError):
        BLIND[name](image)
