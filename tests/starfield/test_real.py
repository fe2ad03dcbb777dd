"""A real frame of another project in which every star is smeared."""

from pathlib import Path

import numpy as np
import pytest

from jitterkit.frames import Frame, read_frames
from jitterkit.starfield import estimate_field

REAL = Path(__file__).parents[2].parent / "shared" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not beside the project")


def test_the_smeared_frame_agrees_with_its_measured_answer():
    (raw,) = read_frames(REAL / "stars" / "long.fits")
    estimate = estimate_field(Frame(raw.data, 0.0, raw.mask))
    sxx, sxy, syy = estimate.common
    mean, half = (sxx + syy) / 2, np.hypot((sxx - syy) / 2, sxy)
    error = np.sqrt(np.diag(estimate.common_covariance))
    # measured by others: 2.00 ± 0.02 and 1.385 ± 0.015 pixels, axis 107.5 ± 0.5 degrees
    assert np.sqrt(mean + half) == pytest.approx(2.00, abs=2 * np.hypot(0.02, error[2] / 4))
    assert np.sqrt(mean - half) == pytest.approx(1.385, abs=2 * np.hypot(0.015, error[0] / 2.8))
    assert estimate.angle == pytest.approx(107.5, abs=2 * np.hypot(0.5, estimate.angle_err))
    # a line of about 5.0 pixels by the moments; a round core under a line says 4.7
    assert estimate.moment_length == pytest.approx(5.0, abs=0.1)
    assert estimate.length == pytest.approx(5.0, abs=3 * estimate.length_err)
    assert estimate.conditional
    assert estimate.pattern.kind == "smear"
    assert estimate.pattern.smear_share > 0.95
    assert estimate.pattern.pattern_share < 0.1
    # the moving object's streak, from (23, 339) to (339, 310), holds no star
    on_streak = np.abs(estimate.y - 339 + (estimate.x - 23) * 29 / 316) < 8
    assert not np.any(on_streak & (estimate.x > 20) & (estimate.x < 345))
