"""Hints at a wavefront error that a fit lacks, in images by direct Fourier sums: none of its formulas."""

import re
from dataclasses import replace

import direct_renderer as direct
import numpy as np
import pytest

from jitterkit.batch import FrameProcessor, diagnose
from jitterkit.frames import RawFrame
from jitterkit.optics import flat_band
from jitterkit.optics.pupil import Pupil, open_pupil
from jitterkit.refit import lacking_wavefront
from jitterkit.refit.lacking_wavefront import _chosen

SAMPLES, FLUX, SHAPE, SCALE = 64, 3e6, (48, 44), 0.375


@pytest.fixture(scope="module")
def lopsided(telescope):
    """Another telescope: about a mirror image of itself, even modes show to second order only."""
    plain = telescope.pupil
    axis = (np.arange(SAMPLES) - 31.5) / 32
    opd = 90.0 * np.sign(np.sin(5 * axis[:, None] + 3 * axis) + 0.3)
    own = open_pupil(np.asarray(plain.transmission), plain.diameter, range(4, 11))
    pupil = Pupil(plain.transmission, plain.diameter, opd, own.basis, own.names, light=float(plain.light))
    return replace(telescope, pupil_from=pupil, spectrum=flat_band(530.0, 640.0, 7))


@pytest.fixture(scope="module")
def processed(lopsided):
    """Process a noisy star, seen through a list of wavefront errors [nm] that share the exposure."""
    pupil, processor = lopsided.pupil, FrameProcessor(lopsided, scene="star", locus="mvn")
    amplitude, opd = np.asarray(pupil.transmission), np.asarray(pupil.opd)

    def process(*errors, scale=1.0, more=(), change=lambda image: image):
        seen = [direct.Telescope(amplitude, opd + one, pupil.diameter, (530.0, 640.0), 7) for one in errors]
        stars = [direct.Source(0.2, -0.3, FLUX), *more]
        image = sum(direct.render(one, stars, SHAPE, SCALE * scale) for one in seen) / len(seen)
        counts = np.random.default_rng(35).poisson(change(image)).astype(float)
        return processor.process(RawFrame.from_array(counts, unit="electron", read_noise=1.0)).result

    return process


def mode(number, size):
    return size * direct.noll_mode(number, SAMPLES)


def causes(message):
    """Read modes, sizes and errors [nm] from a hint, and the share that it claims [%]."""
    named = re.findall(r"(Noll \d+|focus)(?: during the exposure)? of (-?[\d.]+) ± ([\d.]+) nm", message)
    share = re.findall(r"explain (\d+) %", message)
    return {name: (float(size), float(error)) for name, size, error in named}, int(*share)


@pytest.mark.parametrize(
    ("errors", "truth"),
    [
        ([mode(25, -4.0)], {"Noll 25": -4.0}),
        ([mode(12, 3.0) + mode(19, -3.6)], {"Noll 12": 3.0, "Noll 19": -3.6}),
        ([mode(4, 15.0), mode(4, -15.0)], {"focus": 15.0}),
        ([mode(4, 15.0) + mode(30, 6.0), mode(4, -15.0) + mode(30, 6.0)], {"focus": 15.0, "Noll 30": 6.0}),
    ],
)
def test_what_the_wavefront_lacks_is_named_with_its_size(processed, errors, truth):
    result = processed(*errors)
    found, share = causes(result.message)
    assert found.keys() == truth.keys()
    assert share > 80
    for name, size in truth.items():
        # one step: 15 nm are a phase of 0.18 rad, of whose square (3 %) the second order is about one
        assert found[name][0] == pytest.approx(size, abs=4 * found[name][1] + 0.03 * abs(size))
    listed = re.findall(r"add ([\d, ]+) to noll", result.message)
    modes = {name.removeprefix("Noll ") for name in truth} - {"focus"}
    assert set(", ".join(listed).split(", ")) - {""} == modes


def hot(image):
    return image + 150.0 * (np.random.default_rng(1).random(SHAPE) < 0.015)


@pytest.mark.parametrize(
    "cause",
    [
        {"change": lambda image: image + 40 + 0.2 * (np.arange(SHAPE[1]) - 22.0) ** 2},
        {"scale": 1.01},
        {"scale": 1.05},
        {"change": hot},
        {"more": [direct.Source(1.5, 1.5, FLUX / 100)]},
        {"more": [direct.Source(-5.0, 4.0, FLUX / 500)]},
        {"more": [direct.Source(0.7, 0.2, FLUX / 30)]},
        {"change": lambda image: image * (1 - 0.05 * image / image.max())},
    ],
    ids=["sky", "scale", "far scale", "hot pixels", "third star", "far star", "near star", "non-linear"],
)
def test_no_other_cause_is_taken_for_a_wavefront(processed, cause):
    result = processed(0.0, **cause)
    assert "misfit" in result.flags
    assert "would explain" not in result.message


def test_a_pupil_that_has_all_modes_may_still_change_its_focus(processed, monkeypatch):
    monkeypatch.setattr(lacking_wavefront, "_LAST", 10)
    found, _ = causes(processed(mode(4, 15.0), mode(4, -15.0)).message)
    assert found.keys() == {"focus"}


def test_a_frame_that_fits_is_not_tested(processed, monkeypatch):
    monkeypatch.setattr(diagnose, "describe_lacking_wavefront", None)
    assert processed(0.0).flags == ()


def test_a_direction_must_be_significant_for_all_that_are_tried_and_a_variance_positive():
    # of 30 normal deviates one of 5.2 sigmas has a chance of 6e-6, of 5.8 sigmas of 2e-7
    for sigmas, chosen in ((5.2, []), (-5.8, [7]), (5.8, [7])):
        assert _chosen(sigmas * np.eye(30)[7], np.eye(30), 0.0, 30) == chosen
    assert _chosen(-50 * np.eye(30)[29], np.eye(30), 0.0, 29) == []
    assert _chosen(50 * np.eye(30)[29], np.eye(30), 2501.0, 29) == []
    # what a direction shares with a better one is not counted again
    information = np.eye(2) + 0.9 * (1 - np.eye(2))
    assert _chosen(information @ [20.0, 0.0], information, 0.0, 2) == [0]
