import numpy as np
import pytest

from jitterkit.loci import Ellipse, Linear, Mvn, PartialShm, Product, Shm, Smear, Stable
from jitterkit.motion import (
    Line,
    PowerSpectrum,
    Record,
    assess_motion,
    critical_frequency,
    motion_budget,
    predicted_locus,
    regime,
    smeared_locus,
    split_spectrum,
)

MIX = np.array([1.0, -0.6, 2.0])
BROAD = ([0.01, 3.0, 900.0], [1e-4 * MIX, 1e-5 * MIX, 1e-8 * MIX])


def test_the_critical_frequency_has_one_cycle_in_an_exposure():
    assert critical_frequency(0.1) == pytest.approx(10)


@pytest.mark.parametrize(
    ("frequency", "name", "locus"),
    # the frequencies of HST at 0.1 s: one hundredth of a cycle to thirty
    [
        (0.1, "low", "linear"),
        (2.0, "low", "linear"),
        (4.0, "medium", "partial"),
        (15.0, "medium", "partial"),
        (30.0, "high", "shm"),
        (61.0, "high", "shm"),
        (300.0, "high", "shm"),
    ],
)
def test_a_line_has_the_regime_and_the_locus_of_its_cycles(frequency, name, locus):
    assert regime(frequency * 0.1) == name
    (share,) = motion_budget(PowerSpectrum(lines=(Line(frequency, 0.02, 30.0),)), 0.1)
    assert (share.regime, share.locus) == (name, locus)


@pytest.mark.parametrize(("frequency", "locus"), [(1.0, "linear"), (8.0, "path"), (61.0, "ellipse")])
def test_a_whirl_has_two_axes_unless_it_is_slow(frequency, locus):
    (share,) = motion_budget(PowerSpectrum(lines=(Line(frequency, 0.02, 30.0, 0.01),)), 0.1)
    assert share.locus == locus


def test_a_budget_sums_to_the_whole_and_names_random_motion_by_its_regime():
    spectrum = PowerSpectrum(*BROAD, (Line(61.0, 0.02), Line(4.0, 0.01, 20.0)))
    shares = motion_budget(spectrum, 0.1)
    assert [(s.regime, s.locus) for s in shares[:3]] == [
        ("low", "linear"),
        ("medium", "smear"),
        ("high", "mvn"),
    ]
    assert [(s.low, s.high) for s in shares] == [(0.01, 2), (2, 30), (30, 900), (4, 4), (61, 61)]
    whole = split_spectrum(spectrum, 0.1)
    for part in ("displacement", "smear", "jitter"):
        total = sum(getattr(share.split, part) for share in shares)
        np.testing.assert_allclose(total, getattr(whole, part), rtol=1e-10, atol=1e-18)


@pytest.mark.parametrize(
    ("spectrum", "kind"),
    [
        (PowerSpectrum(*BROAD), Smear),
        (PowerSpectrum(lines=(Line(4.0, 0.05, 130.0),)), PartialShm),
        (PowerSpectrum(lines=(Line(4.0, 0.05, 130.0, 0.02),)), Ellipse),
        (PowerSpectrum(lines=(Line(4.0, 1e-6, 130.0, 0.02),)), PartialShm),
        (PowerSpectrum(lines=(Line(63.0, 0.05, 130.0),)), Shm),
        (PowerSpectrum(lines=(Line(63.0, 0.05, 130.0, 0.02),)), Ellipse),
        (PowerSpectrum(*BROAD, (Line(0.5, 0.5, 20.0), Line(7.0, 0.02, 80.0), Line(63.0, 0.05))), Product),
        (PowerSpectrum(lines=(Line(5.0, 0.0), Line(63.0, 0.0))), Stable),
        (PowerSpectrum(lines=(Line(5.0, 0.0), Line(63.0, 0.05))), Shm),
    ],
)
def test_a_typical_frame_has_the_mean_blur(spectrum, kind):
    locus = predicted_locus(spectrum, 0.1)
    assert type(locus) is kind
    blur = split_spectrum(spectrum, 0.1).blur
    # an ellipse as thin as 1e-6 of 0.02 counts as a streak; that ratio squared is left out
    np.testing.assert_allclose(locus.moments(), blur, rtol=1e-8, atol=1e-8 * np.abs(blur).max() + 1e-30)


def test_the_predicted_transfer_function_is_the_product_of_sinc_normal_and_bessel_s():
    from scipy.special import j0

    slow, fast = Line(0.5, 0.5, 0.0), Line(1e6 + 0.5, 0.05, 0.0)  # the fast one is all jitter
    f = np.linspace(0, 3, 7)
    white = PowerSpectrum([1e5, 2e5], np.full((2, 3), [1e-9, 0, 2e-9]), (slow, fast))
    # z = 0.05 pi: of the slow line's variance 0.125, 3 j1(z)² is smear, of √12 times its root, z⁴/45 jitter
    z = 0.05 * np.pi
    length = np.sqrt(12 * 0.125 * 3) * (np.sin(z) - z * np.cos(z)) / z**2
    variance = 1e-9 * 1e5 + 0.125 * z**4 / 45
    expected = np.sinc(f * length) * np.exp(-2 * np.pi**2 * variance * f**2) * j0(2 * np.pi * 0.05 * f)
    got = predicted_locus(white, 0.1).transfer(f, 0 * f)
    # the next term of the jitter is z²/7 of it: 1e-6 in the exponent
    np.testing.assert_allclose(got, expected, atol=2e-6)
    across = predicted_locus(white, 0.1).transfer(0 * f, f)
    np.testing.assert_allclose(across, np.exp(-2 * np.pi**2 * 2e-4 * f**2), rtol=1e-9)


def test_without_blur_the_telescope_is_stable():
    assert isinstance(predicted_locus(PowerSpectrum(), 0.1), Stable)


def test_a_smear_lies_along_its_longer_axis_and_what_is_across_widens_the_normal():
    split = split_spectrum(PowerSpectrum(*BROAD), 0.1)
    smear, rest = smeared_locus(split).factors()
    assert (type(smear), type(rest)) == (Linear, Mvn)
    values, vectors = np.linalg.eigh([[split.smear[0], split.smear[1]], [split.smear[1], split.smear[2]]])
    assert smear.describe()["length"] == pytest.approx(np.sqrt(12 * (values[1] - values[0])))
    assert smear.describe()["angle"] == pytest.approx(np.degrees(np.arctan2(*vectors[::-1, 1])) % 180)


def test_a_spectrum_and_a_record_are_assessed_alike(rng):
    from jitterkit.motion import simulate_pointing

    spectrum = PowerSpectrum([0.5, 200.0], [1e-4 * MIX, 1e-6 * MIX])
    record = simulate_pointing(spectrum, 200.0, 0.001, rng)
    one, other = (assess_motion(motion, 0.1, cadence=0.2, bandwidth=2.0) for motion in (spectrum, record))
    assert (other.frames, other.shares, one.names, other.names) == (1000, (), "smear", "smear")
    # 1000 squares of normal numbers, and chords of 200 Hz every ms: 0.06 of what is there, less of the rest
    for name in ("split", "unguided"):
        ratio = getattr(other, name).blur[[0, 2]] / getattr(one, name).blur[[0, 2]]
        np.testing.assert_allclose(ratio, 1, atol=5 * np.sqrt(2 / 1000) + 0.01)
    np.testing.assert_allclose(other.steps[[0, 2]] / one.steps[[0, 2]], 1, atol=5 * np.sqrt(3 / 1000))


def test_everything_together_is_named_once():
    lines = (Line(0.5, 0.5), Line(7.0, 0.02), Line(8.0, 0.02), Line(63.0, 0.05), Line(90.0, 0.05, 0, 0.05))
    assert assess_motion(PowerSpectrum(lines=lines), 0.1).names == "linear*partial*shm*ellipse"
    held = (Line(0.5, 0.0), Line(7.0, 0.0), Line(63.0, 0.0, 0.0, 0.0))
    assert assess_motion(PowerSpectrum(lines=held), 0.1).names == "stable"
    assert assess_motion(PowerSpectrum(lines=(*held, Line(64.0, 0.0, 0.0, 0.05))), 0.1).names == "shm"
    assert [share.locus for share in assess_motion(PowerSpectrum(lines=held), 0.1).shares] == ["stable"] * 3
    still = Record(np.linspace(0, 1, 50), np.zeros(50), np.zeros(50))
    assert assess_motion(still, 0.1).names == "stable"
