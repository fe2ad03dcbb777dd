"""Further data that tell causes apart: against one dense information of all frames, and against laws."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.forecast.causes import forecast_causes
from jitterkit.forecast.causes_data import FollowUp, Observation, cheapest, further_data
from jitterkit.forecast.causes_frame import Setting
from jitterkit.forecast.causes_information import Information
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.optics import FixedOptics, Grid, OpticalSystem, empirical_otf, flat_band, obstructed_circle
from jitterkit.report.causes_plots import causes_sentences, remedy_sentence, verdicts
from jitterkit.report.words import MINUS
from jitterkit.scene import Binary, Star

SCALE = 0.375


@pytest.fixture(scope="module")
def normal():
    """A normal star image under a round jitter: sigma 0.6 arcsec, jitter 0.3, diffusion 0.1."""
    x = SCALE * (np.arange(41) - 20)
    stamp = np.exp(-(x**2 + x[:, None] ** 2) / (2 * 0.6**2))
    optics = FixedOptics(empirical_otf(stamp, SCALE, (41, 41), pad=12))
    return forecast_causes(Setting(Star(0.0, 0.0, 1e5), optics, diffusion=0.1**2), Mvn.of(0.3))


@pytest.fixture(scope="module")
def seen():
    """A pair under a streak through the air; a telescope of its own, as its defocus is a cause."""
    pupil = obstructed_circle(0.125, 0.04, noll=(4, 7), samples=64)
    optics = OpticalSystem(pupil, flat_band(530.0, 640.0, 3), Grid((32, 32), SCALE, 16))
    scene = Binary(3.0, 150.0, 0.1, -0.2, 1e5, 3.0)
    detector = Detector(gain=2.0, read_noise=3.0)
    return forecast_causes(Setting(scene, optics, detector, (25.0, 0.0), 0.1**2, 0.8), Linear.of(0.6, 20.0))


@pytest.fixture(scope="module")
def sets(seen):
    return further_data(seen, FollowUp(frames=3))


def named(sets, words):
    (one,) = [one for one in sets if words in one.words]
    return one


def test_frames_with_jitters_of_their_own_tell_what_one_dense_matrix_of_all_parameters_does(seen, sets):
    setting, variance = seen.setting, 3.0**2 + 2.0**2 / 12
    # three more: turned by 0, 60 and 120 degrees, of 0.5, 1 and 1.5 times the length
    jitters = [seen.locus, Linear.of(0.3, 20.0), Linear.of(0.6, 80.0), Linear.of(0.9, 140.0)]
    frames = [setting.slopes(locus) for locus in jitters]
    shared = [name for name in frames[0][1] if name in setting.shared]
    own = [name for name in frames[0][1] if name not in shared]
    width, pixels = len(shared) + 4 * len(own), frames[0][0].size
    rows = np.zeros((4 * pixels, width))
    for k, (image, slopes) in enumerate(frames):
        here = slice(k * pixels, (k + 1) * pixels)
        noise = np.sqrt(image + variance)
        for j, name in enumerate(shared):
            rows[here, j] = (slopes[name] / noise).ravel()
        for j, name in enumerate(own):
            rows[here, len(shared) + k * len(own) + j] = (slopes[name] / noise).ravel()
    size = np.linalg.norm(rows, axis=0)
    errors = np.linalg.norm(np.linalg.pinv(rows / size), axis=1) / size
    where = [*shared, *own]  # those of the first frame follow the shared ones
    expected = [errors[where.index(name)] for name in seen.names]
    more = named(sets, "3 more frames, each")
    np.testing.assert_allclose(seen.errors(more.extra), expected, rtol=1e-6)


def test_no_data_ever_make_an_error_larger(seen, sets):
    alone, size = seen.errors(), len(sets)
    for one in sets:
        assert np.all(seen.errors(one.extra) <= alone * (1 + 1e-9)), one.words
    for first, second in ((0, size - 1), (3, 1), (2, size - 2)):
        both = seen.errors((sets[first] + sets[second]).extra)
        assert np.all(both <= seen.errors(sets[first].extra) * (1 + 1e-9))


def test_what_is_exactly_degenerate_no_light_and_no_number_of_frames_separates(normal):
    sets = further_data(normal)
    for words in ("times the light", "8 more frames, each"):
        errors = normal.errors(named(sets, words).extra)
        np.testing.assert_array_equal(np.isfinite(errors), [False, True, False, False])
    light = normal.errors(named(sets, "times the light").extra)
    assert light[1] == pytest.approx(normal.errors()[1] / 2)
    # the turn may hide (0.46 arcsec²/sqrt(1e5))**0.5 = 0.1017 pixels of blur
    assert verdicts(normal, 0.11) == ["undetermined", "determined", "undetermined", "undetermined"]
    assert verdicts(normal, 0.1) == ["undetermined", "determined in part", "undetermined", "undetermined"]
    (degeneracy,) = normal.degeneracies()
    assert degeneracy.pivot == "diffusion"
    assert degeneracy.stretch == np.inf
    (sentence, focus) = causes_sentences(normal)
    for mixed in ("+0.58 diffusion", f"{MINUS}0.58 jitter along 0°", f"{MINUS}0.58 jitter across 0°"):
        assert mixed in sentence
    assert "noll4" in focus


def test_telemetry_breaks_it_as_far_as_it_goes(normal):
    share, flux = 0.05, 1e5
    sets = further_data(normal, FollowUp(frames=1, telemetry=share))
    errors = normal.errors(next(one for one in sets if one.words == "telemetry of the jitter to 5 %").extra)
    total = 0.6**2 + 0.3**2 + 0.1**2
    known, summed = share * 0.3**2, total * (2 / flux) ** 0.5
    # the frame knows both sums, telemetry both variances: two independent differences of them are diffusion
    assert errors[3] == pytest.approx(((known**2 + summed**2) / 2) ** 0.5, rel=1e-3)
    turn = total / flux**0.5
    assert errors[1] == pytest.approx((turn**-2 + known**-2) ** -0.5, rel=1e-3)


def test_a_laboratorys_diffusion_leaves_the_jitter_its_error(normal):
    errors = normal.errors(named(further_data(normal), "diffusion measured").extra)
    known = (0.1 + 0.05 * SCALE) ** 2 - 0.1**2
    summed = (0.6**2 + 0.3**2 + 0.1**2) * (2 / 1e5) ** 0.5
    assert errors[3] == pytest.approx(known, rel=1e-9)
    assert errors[0] == pytest.approx(np.hypot(known, summed), rel=1e-3)


def test_a_frame_at_rest_shows_the_diffusion_alone(normal):
    errors = normal.errors(named(further_data(normal), "a frame at rest").extra)
    at_rest = (0.6**2 + 0.1**2) * 1e5**-0.5  # both axes tell the one variance, each to v sqrt(2/N)
    summed = (0.6**2 + 0.3**2 + 0.1**2) * (2 / 1e5) ** 0.5
    assert errors[3] == pytest.approx(at_rest, rel=1e-3)
    assert errors[0] == pytest.approx(np.hypot(at_rest, summed), rel=1e-3)


@pytest.mark.slow
def test_a_refocused_pair_tells_the_size_of_a_defocus_whose_sign_is_hidden(seen):
    setting = Setting(seen.setting.scene, seen.setting.optics, None, (0.0, 0.0), 0.1**2, 0.8)
    found = forecast_causes(setting, Mvn.of(0.2))
    assert found.setting.square
    others = causes_sentences(replace(found, setting=replace(found.setting, square=False)))
    (focus,) = set(causes_sentences(found)) - set(others)
    assert "defocus" in focus
    pair = named(further_data(found, FollowUp(frames=1, diversity=60.0)), "refocused by ±60 nm")
    i = found.names.index("noll4_square")
    alone, paired = (
        found.causes[i].size_error(errors[i]) for errors in (found.errors(), found.errors(pair.extra))
    )
    moved = [
        Setting(setting.scene, setting.optics, None, (sign * 60.0, 0.0), 0.1**2, 0.8).frame(Mvn.of(0.2))
        for sign in (1, -1)
    ]
    shared = ("noll4", "noll7", "seeing", "diffusion")
    together = moved[0].about(shared) + moved[1].about(shared)
    # what the frame itself says of the square adds next to nothing
    assert paired == pytest.approx(together.errors[0], rel=1e-4)
    assert paired < 0.2 * alone


def test_the_halves_of_a_band_hold_the_light_of_one_frame_and_a_redder_filter_sees_less_sharply(seen):
    # without a sky, which the fainter and wider images of a half tell less well from their wings
    seen = forecast_causes(replace(seen.setting, hold=("background",)), seen.locus)
    sets = further_data(seen, FollowUp(frames=3))
    same = seen.setting.frame(seen.locus).about(seen.setting.shared)
    names = same.names

    def strength(words):
        information = named(sets, words).extra.padded(names).matrix
        return np.diag(information) / np.diag(same.matrix)

    # half the photons in each, and 5 % of the wavelength from the middle: as much in all, a little sharper
    assert np.all(np.abs(strength("halves of the band") - 1) < 0.1)
    # of the same photons, a rounder and wider image tells less of every blur
    assert np.all(strength("1.4 times the wavelength")[-2:] < 0.9)


def test_the_cheapest_is_the_first_that_serves_or_the_first_pair(seen):
    (weak, strong), names = (0.5, 1e-3), seen.names

    def knows(words, errors):
        scale = dict(zip(names, seen.information.alone, strict=True))
        return Observation(words, Information.prior({n: e * scale[n] for n, e in errors.items()}))

    weakly = knows("weak", dict.fromkeys(names, weak))
    half, other = (
        knows("half", dict.fromkeys(names[:2], strong)),
        knows("other", dict.fromkeys(names[2:], strong)),
    )
    target = 3 * float(np.max(seen.shares(strong * seen.information.alone)))
    pair = cheapest(seen, [weakly, half, other], target).words
    assert [name in pair for name in ("weak", "half", "other")] == [False, True, True]
    whole = knows("whole", dict.fromkeys(names, strong))
    assert cheapest(seen, [weakly, half, other, whole], target).words == "whole"
    assert cheapest(seen, [weakly], target) is None
    for sets, wanted, named_in_it in (
        ([weakly], target, []),
        ([weakly, whole], target, ["whole"]),
        ([weakly, whole], 1e9, []),  # the frame alone will do
    ):
        sentence = remedy_sentence(seen, sets, wanted)
        assert f"{100 * wanted:g} %" in sentence
        assert [one.words for one in sets if one.words in sentence] == named_in_it


def test_the_error_of_a_cause_of_no_size_is_no_share_of_it(seen):
    there = replace(seen, causes=tuple(cause._replace(value=1e-2) for cause in seen.causes))
    sentence = remedy_sentence(there, [], 1e9)
    assert "1e+11 %" in sentence
    assert not any(value in sentence for value in ("size 0", "pixel", *there.names))
    *others, diffusion = there.causes
    absent = replace(there, causes=(*others, diffusion._replace(value=0.0)))
    sentence = remedy_sentence(absent, [], 0.5)
    for value in ("50 %", "diffusion, of size 0", "0.5 pixel"):
        assert value in sentence


def test_without_jitter_there_is_nothing_to_tell_of_it():
    pupil = obstructed_circle(0.125, 0.04, noll=(), samples=64)
    optics = OpticalSystem(pupil, flat_band(530.0, 640.0, 3), Grid((32, 32), SCALE, 16))
    found = forecast_causes(Setting(Star(0.0, 0.0, 1e5), optics, diffusion=0.1**2), Stable.of())
    assert found.names == ("diffusion",)
    words = " ".join(one.words for one in further_data(found))
    assert "telemetry" not in words
    assert "refocused" not in words


def test_of_a_jitter_that_may_be_there_but_is_not_a_frame_at_rest_determines_the_most(normal):
    still = forecast_causes(normal.setting, Mvn.of(0.0))
    sets = further_data(still, FollowUp(frames=1))
    assert not any("telemetry" in one.words for one in sets)
    assert np.all(np.isfinite(still.errors(named(sets, "a frame at rest").extra)))
    with refused(ErrorCode.OUT_OF_RANGE, "frames", 0):
        FollowUp(frames=0)
