"""The variance of a file as read variance: no bias is left, unlike with the variance as it stands."""

import numpy as np
import pytest

from jitterkit.detectors import Detector
from jitterkit.frames import Metadata, RawFrame

READ = 5.0
YY, XX = np.mgrid[:32, :32] - 15.5


def spot(x):
    return np.exp(-((XX - x) ** 2 + YY**2) / (2 * 2.0**2)) / (2 * np.pi * 2.0**2)


def pair(parameters):
    """Expected electrons of two stars, of a separation in pixels and fluxes, on a sky."""
    separation, one, two, sky = parameters
    return one * spot(-separation / 2) + two * spot(separation / 2) + sky


TRUTH = np.array([7.0, 4000.0, 2000.0, 20.0])
EXPECTED = pair(TRUTH)
STEPS = np.diag([1e-4, 1.0, 1.0, 1e-2])
SLOPES = np.stack([(pair(TRUTH + step) - pair(TRUTH - step)).ravel() / (2 * step.sum()) for step in STEPS])


def pipeline_variance(electrons, expected, kind):
    return {
        "of the data": np.maximum(electrons, 0) + READ**2,
        "of the data before the sky was subtracted": np.maximum(electrons + 30, 0) + READ**2,
        "of a model": expected + READ**2,
        "divided by a flat": np.maximum(electrons, 0) / (1 + 0.02 * np.sin(XX)) + READ**2,
    }[kind]


KINDS = ("of the data", "of the data before the sky was subtracted", "of a model", "divided by a flat")


def frames(kind, count, gain=1.0, seed=5):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        sky = 30.0 * ("sky" in kind)
        electrons = rng.poisson(EXPECTED + sky) - sky + rng.normal(0, READ, EXPECTED.shape)
        variance = pipeline_variance(electrons, EXPECTED, kind)
        unit = "electron" if gain == 1 else "adu"
        yield RawFrame.from_array(electrons / gain, variance=variance / gain**2, unit=unit)


def estimates(kind, weights_of, count=200):
    """Mean deviation from the truth of the best linear estimates of frames, in standard errors."""
    found = []
    for raw in frames(kind, count):
        frame = Detector().calibrate(raw)
        weight = 1 / weights_of(raw, frame).ravel()
        normal = (SLOPES * weight) @ SLOPES.T
        found.append(np.linalg.solve(normal, (SLOPES * weight) @ (frame.electrons - EXPECTED).ravel()))
    return np.mean(found, axis=0) / (np.std(found, axis=0) / np.sqrt(count))


def kept(raw, frame):
    return EXPECTED + frame.read_variance


def naive(raw, frame):
    return raw.variance


@pytest.mark.parametrize("kind", KINDS)
def test_no_bias_is_left_in_separation_fluxes_and_sky(kind):
    assert np.abs(estimates(kind, kept)).max() < 4  # of four parameters, 2.5e-4 of all draws


def test_weights_of_the_noisy_data_bias_the_sky():
    """Neyman's chi-squared takes a Poisson mean to be lower by up to one count."""
    assert estimates("of the data", naive)[3] < -20


@pytest.mark.parametrize("kind", ["of the data", "of a model", "divided by a flat"])
def test_the_read_variance_is_the_square_of_the_read_noise(kind):
    (raw,) = frames(kind, 1)
    frame = Detector(read_noise=1.0, sources={"read_noise": "instrument file"}).calibrate(raw)
    assert np.median(frame.read_variance) == pytest.approx(READ**2, rel=0.05)
    assert frame.metadata.value("read_noise") == pytest.approx(READ, rel=0.03)
    assert "read_noise_assumed" not in frame.flags


def test_the_sky_that_was_subtracted_stays_in_the_read_variance():
    (raw,) = frames("of the data before the sky was subtracted", 1)
    assert np.median(Detector().calibrate(raw).read_variance) == pytest.approx(READ**2 + 30, rel=0.05)


@pytest.mark.parametrize("kind", ["of the data", "of a model"])
def test_a_gain_that_nobody_said_follows_from_the_variance(kind):
    (raw,) = frames(kind, 1, gain=2.5)
    frame = Detector(gain=3.6, bias=30.0, sources={"gain": "preset", "bias": "preset"}).calibrate(raw)
    assert frame.metadata.value("gain") == pytest.approx(2.5, rel=0.05)
    assert frame.metadata.value("bias") == 0.0
    assert "gain_assumed" not in frame.flags
    said = RawFrame(raw.data, metadata=raw.metadata.override("header", gain=2.4), variance=raw.variance)
    assert Detector().calibrate(said).metadata.value("gain") == 2.4


def test_a_weight_without_photon_noise_is_used_as_it_is():
    (raw,) = frames("of the data", 1)
    ramp = READ**2 * (1 + 0.5 * (YY > 0))
    frame = Detector().calibrate(RawFrame(raw.data, metadata=raw.metadata, variance=ramp))
    np.testing.assert_allclose(frame.read_variance, ramp)


def test_a_noisy_pixel_keeps_its_own_variance():
    (raw,) = frames("of a model", 1)
    variance = raw.variance.copy()
    variance[3, 4] += 2500.0
    frame = Detector().calibrate(RawFrame(raw.data, metadata=raw.metadata, variance=variance))
    assert frame.read_variance[3, 4] == pytest.approx(2500 + READ**2, rel=0.05)
    assert np.median(frame.read_variance[2:5, 2:4]) == pytest.approx(READ**2, rel=0.2)


@pytest.mark.parametrize("factor", [10.0, 30.0])
def test_a_variance_in_another_unit_is_not_used(factor):
    (raw,) = frames("of the data", 1)
    wrong = RawFrame(
        raw.data, metadata=raw.metadata, variance=raw.variance * factor, variance_source="ERR (HDU 2)"
    )
    frame = Detector(read_noise=3.0, sources={"read_noise": "instrument file"}).calibrate(wrong)
    np.testing.assert_array_equal(frame.read_variance, 9.0)
    assert any("ERR (HDU 2) rises" in text for text in frame.metadata.warnings)


def test_a_read_noise_of_the_command_line_is_obeyed():
    (raw,) = frames("of the data", 1)
    told = raw.with_metadata(raw.metadata.override("command line", read_noise=2.0))
    frame = Detector().calibrate(told)
    np.testing.assert_array_equal(frame.read_variance, 4.0)
    assert any("is not used" in text for text in frame.metadata.warnings)


def test_a_variance_of_a_rate_is_multiplied_twice_by_the_exposure():
    (raw,) = frames("of the data", 1)
    rate = RawFrame(
        raw.data / 8, variance=raw.variance / 64,
        metadata=Metadata().override("header", unit="electron/s", exposure=8.0),
    )  # fmt: skip
    np.testing.assert_allclose(
        Detector().calibrate(rate).read_variance, Detector().calibrate(raw).read_variance, rtol=1e-5
    )


def test_bits_of_an_instrument_choose_the_mask():
    quality = np.zeros(EXPECTED.shape, int)
    quality[1, 2], quality[3, 4] = 1, 2
    raw = RawFrame(EXPECTED, quality=quality)
    assert Detector().calibrate(raw).mask.sum() == 2
    assert np.argwhere(Detector(bad_bits=2).calibrate(raw).mask).tolist() == [[3, 4]]
    assert not Detector(bad_bits=0).calibrate(raw).mask.any()


FIELD = np.pad(EXPECTED - 20, ((0, 64), (64, 0)))  # dark sky for the most part


def field(variance, weighted, expected=FIELD, seed=3, frames=1):
    """A mean of frames in electrons, with a variance that may be the inverse of a weight."""
    rng = np.random.default_rng(seed)
    shots = rng.poisson(expected * frames) / frames
    data = shots + rng.normal(0, READ / np.sqrt(frames), expected.shape)
    metadata = Metadata().override("header", unit="electron", read_noise=READ)
    return RawFrame(data, metadata=metadata, variance=variance, variance_source="WHT", weighted=weighted)


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("factor", [1 / 100, 1 / 25, 25, 1e4])
def test_a_noise_that_the_pixels_deny_is_named_and_as_a_weight_not_used(factor, weighted):
    variance = np.full(FIELD.shape, factor * READ**2)
    variance[5, 6] = 0
    frame = Detector().calibrate(field(variance, weighted))
    assert any("WHT" in text and "scatter" in text for text in frame.metadata.warnings)
    assert frame.mask[5, 6]
    own = frame.read_variance[~frame.mask] == READ**2
    assert own.all() if weighted else not own.any()


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("factor", [1 / 5, 1 / 2, 1, 2, 5])
@pytest.mark.parametrize("light", [0, 1])
def test_a_noise_that_suits_the_pixels_is_used_without_a_warning(light, factor, weighted):
    frame = Detector().calibrate(field(light * FIELD + factor * READ**2, weighted))
    assert not any("scatter" in text for text in frame.metadata.warnings)
    assert frame.metadata.read_noise.source.startswith("WHT")


def test_a_pattern_that_fills_the_frame_is_no_noise():
    """Speckles as wide as those of a diffractive pupil, in a mean of 30 frames."""
    phases = np.random.default_rng(8).uniform(0, 2 * np.pi, (12, 12))
    y, x = np.mgrid[:96, :96]
    waves = sum(
        np.exp(1j * (2 * np.pi * (i * x + j * y) / 60 + phases[i, j])) for i in range(12) for j in range(12)
    )
    pattern = 3.0 * np.abs(waves) ** 2
    raw = field((pattern + READ**2) / 30, weighted=True, expected=pattern, frames=30)
    frame = Detector().calibrate(raw)
    assert not any("scatter" in text for text in frame.metadata.warnings)
    assert frame.metadata.read_noise.source.startswith("WHT")
