"""Blur of frames of a pair, from file to table: no pair, aberrations, frames that no pair describes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.batch import FrameProcessor
from jitterkit.batch.template_blur import TemplateBlurEstimator
from jitterkit.detectors import Detector
from jitterkit.frames import read_frames, write_fits
from jitterkit.likelihood import POOR
from jitterkit.loci import Linear
from jitterkit.run.estimate import estimate_files
from jitterkit.run.products import _draw
from jitterkit.scene import Binary
from jitterkit.simulate import fits_header, simulate_sequence


def test_a_frame_without_a_pair_is_a_row_with_a_status(telescope, tmp_path):
    write_fits(tmp_path / "dark.fits", np.random.default_rng(1).normal(100.0, 3.0, (64, 64)))
    measurer = TemplateBlurEstimator(FrameProcessor(telescope))
    (row,) = estimate_files([tmp_path / "dark.fits"], measurer)
    assert (row["status"], row["reason"]) == ("no_star", "no_star")
    assert np.isnan(row["sxx"].value)


@pytest.fixture(scope="module")
def drifted(telescope, tmp_path_factory):
    """A pair through optics with 5 nm of aberrations, blurred by 0.9 arcsec."""
    rng = np.random.default_rng(3)
    aberrations = rng.normal(0, 5.0, (1, len(telescope.aberrations)))
    scene = Binary(8.0, 30.0, 1.0, -2.0, telescope.flux, 3.0)
    (one,) = simulate_sequence(
        telescope, scene, Linear.of(0.9, 35.0), 1, aberrations=aberrations, rng=rng, detector=False
    )
    path = tmp_path_factory.mktemp("drifted") / "drifted.fits"
    return write_fits(path, one.raw.data, header=fits_header(one, telescope))


def test_a_pair_with_aberrations_is_described_by_its_template(telescope, drifted):
    (row,) = estimate_files([drifted], TemplateBlurEstimator(FrameProcessor(telescope)))
    assert (row["status"], row["reason"], row["message"]) == ("ok", "", "")


def test_an_estimate_says_what_its_file_leaves_in_doubt(telescope, drifted, tmp_path):
    """A gain of 4 e-/ADU that nobody says and that is taken to be 1 makes errors twice too large."""
    electrons, header = fits.getdata(drifted, header=True)
    cards = {"NCOMBINE": 9, "BUNIT": "adu", **{key: header[key] for key in ("PIXSCALE", "EXPTIME")}}
    write_fits(tmp_path / "adu.fits", electrons / 4, header=cards)
    telescope = replace(telescope, detector=Detector(bias=0.0))
    (row,) = estimate_files([tmp_path / "adu.fits"], TemplateBlurEstimator(FrameProcessor(telescope)))
    assert row["status"] == "ok", row["message"]
    said = ("NCOMBINE = 9", "gain_assumed", "read_noise_assumed", "less than chance allows")
    assert [word for word in said if word not in row["message"]] == [], row["message"]
    (raw,) = read_frames(tmp_path / "adu.fits")
    result = FrameProcessor(telescope, scene="binary", locus="linear").process(raw).result
    assert "misfit" in result.flags
    assert "less than chance allows" in result.message


@pytest.mark.slow
def test_a_frame_that_no_binary_describes_is_a_poor_fit_that_names_its_scale_and_the_other_ways(
    telescope, tmp_path
):
    # one star of 3 pixels rms where two of the instrument's resolution are expected
    y, x = np.indices(telescope.shape)
    star = 2e4 * np.exp(-((x - 24) ** 2 + (y - 20) ** 2) / 18.0)
    star = np.random.default_rng(4).poisson(star + 1.0).astype(float)
    header = {"BUNIT": "electron", "PIXSCALE": 1.3 * telescope.plate_scale}
    write_fits(tmp_path / "one.fits", star, header=header)
    kept = []
    (row,) = estimate_files(
        [tmp_path / "one.fits"], TemplateBlurEstimator(FrameProcessor(telescope)), keep=kept.append
    )
    assert (row["status"], row["reason"]) == ("poor_fit", "model_mismatch")
    assert np.isnan(row["sxx"].value)
    assert kept == []
    assert row["message"].count(f"{1.3 * telescope.plate_scale:g} arcsec") == 1
    assert all(f" {way}" in row["message"] for way in ("--stars", "--reference", "--blind", "-i"))


class _Blind(FrameProcessor):
    """Finds the pair, and no blur."""

    def estimate(self, frame, **kwargs):
        found = super().estimate(frame, **kwargs)
        return replace(found, estimate=replace(found.estimate, moments=np.zeros(3), locus=None))


def test_an_estimate_that_misses_the_blur_of_a_pair_is_said_to_and_the_pair_is_not_questioned(
    telescope, drifted
):
    (row,) = estimate_files([drifted], TemplateBlurEstimator(_Blind(telescope)))
    assert (row["status"], row["reason"]) == ("ok", "")
    without, fitted = map(float, re.findall(r"chi2/dof\D+([\d.e+]+),\D+([\d.e+]+):", row["message"])[0])
    assert without > POOR >= fitted


class _Insensitive(FrameProcessor):
    """Of a detector that counts a quarter, and whose frames are divided by that."""

    def calibrate(self, raw):
        frame = super().calibrate(raw)
        return replace(frame, electrons=frame.electrons / 0.25, ceiling=frame.ceiling / 0.25, response=0.25)


@pytest.mark.slow
def test_the_picture_s_residual_is_in_sigmas_of_what_was_counted(telescope, drifted):
    titles = []
    for kind in (FrameProcessor, _Insensitive):
        estimate_files(
            [drifted],
            TemplateBlurEstimator(kind(telescope)),
            keep=lambda one: titles.append(_draw(one)[2].get_title()),
        )
    plain, divided = titles
    assert divided == plain
