"""References that are too blurred, just as sharp, or trailed themselves."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.kernel_estimate import refuse_blurrier
from jitterkit.starfield import estimate_field, field_psf
from jitterkit.starfield.certainty import TOLERATED, elongation

NOISE = 0.01**2 * np.diag([1.0, 0.5, 1.0])


def line(length, angle):
    """Moments of a uniform line."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return length**2 / 12 * np.array([c * c, c * s, s * s])


def wider(variance):
    return variance * np.array([1.0, 0.0, 1.0])


def test_a_trailed_reference_is_refused_for_a_sharp_frame(sharp, trailed):
    with refused(ErrorCode.BAD_REFERENCE, "along 30 degrees", error=UndeterminedError):
        estimate_field(sharp[0], reference=field_psf(trailed[0]))


@pytest.mark.parametrize(
    ("excess", "values"),
    [
        (-line(4.0, 25.0), ["along 25 degrees", "1.33 pixel²"]),
        (-wider(0.2), ["all round", "0.2 pixel²"]),
        (line(4.0, 25.0) - line(4.0, 115.0), ["along 115 degrees", "1.33 pixel²", "along 25 degrees"]),
        (line(4.0, 25.0) - wider(0.5), ["along 115 degrees", "0.5 pixel²", "along 25 degrees"]),
    ],
)
def test_where_and_by_how_much_the_reference_is_blurrier_is_said(excess, values):
    with refused(ErrorCode.BAD_REFERENCE, *values, error=UndeterminedError):
        refuse_blurrier(excess, NOISE, tolerated=TOLERATED)


@pytest.mark.parametrize(
    "excess", [line(4.0, 25.0), line(4.0, 25.0) - wider(0.15), wider(0.3), -wider(0.04), wider(0.0)]
)
def test_noise_and_a_small_change_of_seeing_are_not_refused(excess):
    refuse_blurrier(excess, NOISE, tolerated=TOLERATED)  # 0.04 is four of the errors


@pytest.mark.parametrize("seed", [1, 2])
def test_a_frame_as_sharp_as_its_reference_has_no_trail(field, trail, sharp, seed):
    frame, _ = field(np.random.default_rng(seed), trail(0.0, 0.0), stars=40, side=400)
    estimate = estimate_field(frame, reference=sharp[0])
    assert np.isnan(estimate.length)
    assert np.isnan(estimate.length_err)
    assert estimate.pattern.kind == "sharp"
    assert estimate.pattern.sentence.startswith("sharp:")
    # 16 of three degrees of freedom, noise alone: one field in a thousand
    assert estimate.kernel.significance < 16
    assert not estimate.remarks


def test_frames_that_are_all_trailed_are_said_to_be(field, trail, trailed):
    frame, _ = field(np.random.default_rng(3), trail(4.0, 30.0), stars=40, side=400)
    estimate = estimate_field(frame, reference=field_psf(trailed[0]))
    assert estimate.pattern.kind == "sharp"
    # moments overstate a line of 4 pixels by 13 %
    assert "4.5 pixels along 30 degrees" in estimate.remarks[0]


def test_round_stars_are_not_called_long(sharp):
    assert elongation(field_psf(sharp[0])) is None
