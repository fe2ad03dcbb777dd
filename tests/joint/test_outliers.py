"""Cosmic rays in some frames of a sequence."""

from __future__ import annotations

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Frame
from jitterkit.joint import Constant, Exposure, FrameFitter, SequenceOptions, refit_sequence
from jitterkit.locate import Residual
from jitterkit.loci import Mvn
from jitterkit.refit.outliers import Fitted, fit_without_outliers
from jitterkit.scene import Binary

STEP, HIT = 0.1, (2, 5)
SCENE = Binary(5.0, 30.0, 0.0, 0.0, 1e5, 2.5)
CONSTANT = SequenceOptions(time_models={"aberrations": Constant()})


RAYS = ((29, 32), (26, 24), (32, 28), (25, 32))
"""Rows and columns beside the stars where light draws them apart."""


@pytest.fixture(scope="module")
def exposures(optics):
    """Eight frames without noise; in two of them rays of 18 sigma."""
    truth = Parameters(SCENE, Mvn.of(0.1), np.zeros(2), 3.0)
    image = np.asarray(expected_image(truth, optics.nominal))
    made = []
    for i in range(8):
        counts = image.copy()
        for ray in RAYS if i in HIT else ():
            counts[ray] += 18 * np.sqrt(image[ray])
        frame = Frame(counts, 0.0, exposure=STEP, plate_scale=0.375)
        made.append(Exposure(f"frame {i}", (i + 0.5) * STEP, frame))
    return made


def test_rays_are_left_out_of_the_frames_that_they_hit(exposures, optics, monkeypatch):
    """Without noise what is left of the joint separation is all theirs."""
    joint = refit_sequence(exposures, FrameFitter(optics), CONSTANT)
    value, error = joint.separation
    assert value == pytest.approx(5.0, abs=1e-3 * error)
    assert joint.combined.kept.all()
    told = ["outliers_left_out" in record.flags for record in joint.records]
    assert told == [i in HIT for i in range(8)]
    assert all("4 pixels" in record.message for i, record in enumerate(joint.records) if i in HIT)
    monkeypatch.setattr(Residual, "outliers", lambda self, *_, **__: np.zeros_like(self.data.used))
    value, error = refit_sequence(exposures, FrameFitter(optics), CONSTANT).separation
    assert value - 5.0 > 2.5 * error


def test_what_a_pass_left_out_counts_towards_the_few(exposures, optics):
    """Four pixels of 2112 may go, so that a frame that lacks them already keeps all others."""
    frame, fitter = exposures[HIT[0]].frame, FrameFitter(optics)
    before = np.zeros(frame.shape, bool)
    before[:1, :4] = True
    masked, fitted = fit_without_outliers(
        frame, lambda frame: Fitted(*fitter.fit_first(frame, None)), known=before
    )
    np.testing.assert_array_equal(masked.mask, before)
    assert "4 pixels" in fitted.result.message
