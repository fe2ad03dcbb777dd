"""Simulated frames: what is put in must be what an independent eye finds in them."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.instruments import Instrument
from jitterkit.loci import Linear, Mvn, PartialShm, Shaped, Shm, Stable, locus_name
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.scene import Binary, Star
from jitterkit.simulate import simulate_frame, simulate_sequence

SCALE = 0.4
CAMERA = Detector(gain=2.0, read_noise=3.0, bias=50.0, bits=16)
SCENE = Binary(separation=4.0, theta=25.0, x=0.3, y=-0.5, flux=2e5, contrast=2.0)
LOCI = [Stable.of(), Linear.of(1.0, 30.0), Shm.of(0.8, 110.0), Mvn.of(0.3, 0.1, 70.0)]


def gaussian_star():
    """A star of 2.2 pixels sigma: 4e-11 of it at Nyquist's frequency, 3e-15 at the edges of the stamp."""
    x, y = np.meshgrid(np.arange(37) - 18, np.arange(37) - 18)
    return np.exp(-(x**2 + y**2) / (2 * 2.2**2))


BLOB = Instrument("blob", SCALE, (64, 72), CAMERA, psf_from=gaussian_star, exposure=0.5, flux=2e5)
# A telescope of its own: of the defocus it shows the square, so that a first order is not enough.
PLAIN = Instrument(
    "small",
    0.375,
    (32, 32),
    CAMERA,
    flat_band(530.0, 640.0, 3),
    obstructed_circle(0.125, 0.04, noll=(4, 7), samples=64),
    exposure=0.5,
)


def moments(image):
    """Sum, mean place and second moments (x, y) of an image, in arcsec from the frame's centre."""
    y, x = (np.indices(image.shape) - (np.array(image.shape)[:, None, None] - 1) / 2) * SCALE
    total = image.sum()
    cx, cy = (x * image).sum() / total, (y * image).sum() / total
    second = [
        ((a - ca) * (b - cb) * image).sum() / total
        for a, ca, b, cb in ((x, cx, x, cx), (x, cx, y, cy), (y, cy, y, cy))
    ]
    return total, np.array([cx, cy]), np.array(second)


@pytest.mark.parametrize("locus", LOCI, ids=lambda locus: type(locus).__name__)
def test_one_star_has_its_place_its_light_and_the_moments_of_jitter_and_telescope(locus):
    total, position, second = moments(
        simulate_frame(BLOB, Star(0.7, -1.1, 2e5), locus, detector=False).raw.data
    )
    assert total == pytest.approx(2e5, rel=1e-9)
    assert position == pytest.approx([0.7, -1.1], abs=1e-6)
    # a star of 2.2 pixels sigma, which its own pixels have widened already
    telescope = (2.2 * SCALE) ** 2 * np.array([1, 0, 1])
    assert second == pytest.approx(telescope + np.asarray(locus.moments()), abs=1e-6)


def test_one_star_has_no_separation(rng):
    with refused(ErrorCode.UNKNOWN_NAME, "star", "separation", "x, y, flux"):
        next(simulate_sequence(BLOB, Star(0, 0, 2e5), Stable.of(), 1, separation=[3.0], rng=rng))


@pytest.mark.parametrize("locus", LOCI, ids=lambda locus: type(locus).__name__)
def test_the_moments_of_an_image_are_those_of_stars_and_jitter_and_telescope_together(locus):
    image = simulate_frame(BLOB, SCENE, locus, background=0.0, detector=False).raw.data
    total, position, second = moments(image)
    # A has 2/3 of the light and B, 4 arcsec from it towards 25 degrees, 1/3: the photocentre lies 1/6 of
    # the separation from the midpoint towards A, and the pair has the variance 2/9 separation²
    towards_b = np.array([np.cos(np.radians(25.0)), np.sin(np.radians(25.0))])
    assert total == pytest.approx(2e5, rel=1e-9)
    assert position == pytest.approx(np.array([0.3, -0.5]) - 4.0 / 6 * towards_b, abs=1e-6)
    pair = 2 / 9 * 16.0 * np.array([towards_b[0] ** 2, towards_b.prod(), towards_b[1] ** 2])
    _, _, star = moments(np.pad(gaussian_star(), 10))
    assert second == pytest.approx(star + pair + np.asarray(locus.moments()), abs=1e-4)


def test_without_a_generator_and_a_detector_a_frame_is_its_own_expectation():
    simulated = simulate_frame(BLOB, SCENE, LOCI[1], background=7.0, detector=False)
    assert np.array_equal(simulated.raw.data, simulated.expected)
    assert simulated.raw.unit == "electron"
    assert simulated.expected[0, 0] == pytest.approx(7.0, abs=1e-6)


@pytest.mark.parametrize("detector", [True, False])
def test_noise_about_the_expectation_is_what_the_calibrated_variance_says(detector):
    simulated = simulate_frame(
        BLOB, SCENE, LOCI[3], background=20.0, rng=np.random.default_rng(4), detector=detector
    )
    frame = CAMERA.calibrate(simulated.raw)
    pull = (frame.electrons - simulated.expected) / np.sqrt(simulated.expected + frame.read_variance)
    n = pull.size
    assert pull.mean() == pytest.approx(0.0, abs=4 / np.sqrt(n))
    assert pull.var() == pytest.approx(1.0, abs=4 * np.sqrt((2 + 1 / 20) / n))
    assert frame.flags == ()


def test_noise_free_readings_are_the_expectation_to_half_a_step():
    simulated = simulate_frame(BLOB, SCENE, LOCI[0])
    frame = CAMERA.calibrate(simulated.raw)
    assert np.abs(frame.electrons - simulated.expected).max() <= CAMERA.gain / 2 + 1e-9


def test_one_seed_gives_one_frame_to_the_bit():
    first, again, other = (
        simulate_frame(BLOB, SCENE, LOCI[2], rng=np.random.default_rng(s)).raw.data for s in (9, 9, 10)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_aberrations_enter_exactly_and_not_to_first_order():
    state = np.array([40.0, -25.0])
    image = simulate_frame(PLAIN, SCENE, LOCI[0], aberrations=state, detector=False, pad=8).expected
    pupil = PLAIN.pupil
    # the same wavefront as a static error of the telescope leaves no aberration to expand in
    static = obstructed_circle(0.125, 0.04, noll=(), samples=64)
    opd = np.tensordot(state, np.asarray(pupil.basis), 1)
    static = type(pupil)(static.transmission, 0.125, opd=opd, light=static.light)
    other = Instrument("static", 0.375, (32, 32), CAMERA, PLAIN.spectrum, static)
    expected = simulate_frame(other, SCENE, LOCI[0], detector=False, pad=8).expected
    assert image == pytest.approx(expected, abs=1e-9 * image.max())
    flat = simulate_frame(PLAIN, SCENE, LOCI[0], detector=False, pad=8).expected
    assert np.abs(image - flat).max() > 0.01 * image.max()


def test_a_sequence_is_its_frames_one_by_one():
    theta, x, y = np.array([0.0, 120.0, 240.0]), np.array([0.0, 0.5, 1.0]), np.array([0.1, 0.2, 0.3])
    states = np.array([[0.0, 0.0], [5.0, -5.0], [5.0, -5.0]])
    sequence = list(
        simulate_sequence(
            PLAIN,
            SCENE,
            LOCI[1],
            3,
            theta=theta,
            x=x,
            y=y,
            aberrations=states,
            rng=np.random.default_rng(1),
            pad=8,
        )
    )
    rng = np.random.default_rng(1)
    for i, simulated in enumerate(sequence):
        scene = Binary(4.0, theta[i], x[i], y[i], 2e5, 2.0)
        alone = simulate_frame(PLAIN, scene, LOCI[1], aberrations=states[i], rng=rng, pad=8)
        assert np.array_equal(simulated.raw.data, alone.raw.data)
        assert float(simulated.truth.scene.theta) == theta[i]
        assert simulated.raw.index == i


def test_a_sequence_with_common_optics_expands_them_once(monkeypatch):
    calls, original = [], Instrument.optics
    monkeypatch.setattr(Instrument, "optics", lambda *a, **k: calls.append(1) or original(*a, **k))
    list(simulate_sequence(PLAIN, SCENE, LOCI[0], 4, theta=np.arange(4.0), pad=8))
    assert len(calls) == 1


def test_a_simulated_frame_knows_what_the_instrument_knew():
    metadata = simulate_frame(BLOB, SCENE, LOCI[0]).raw.metadata
    known = {name: known.value for name, known in metadata.known().items()}
    assert known == {
        "exposure": 0.5,
        "gain": 2.0,
        "read_noise": 3.0,
        "saturation": 65535.0,
        "bias": 50.0,
        "plate_scale": SCALE,
        "unit": "adu",
    }


@pytest.mark.parametrize(
    ("arrays", "values"),
    [
        ({"theta": [1.0]}, ["theta", "(1,)", "2 frames"]),
        ({"aberrations": np.zeros((3, 2))}, ["aberrations", "(3, 2)", "(2,)", "(2, 2)", "nm"]),
    ],
)
def test_arrays_of_another_length_are_refused(arrays, values):
    with refused(ErrorCode.WRONG_SHAPE, *values):
        next(simulate_sequence(PLAIN, SCENE, LOCI[0], 2, **arrays))


def test_aberrations_that_a_telescope_does_not_have_are_refused():
    with refused(ErrorCode.CONFLICT, "'blob'"):
        simulate_frame(BLOB, SCENE, LOCI[0], aberrations=[1.0])


@pytest.mark.parametrize("locus", [PartialShm.of(3.75, 25.0, 3.0), Shaped.of(1.5, 0.0, 25.0, -1.2)])
def test_a_jitter_beyond_its_quadrature_or_series_is_refused(locus):
    with refused(ErrorCode.SAMPLING, locus_name(locus), f"{locus.exact_to():.3g}"):
        simulate_frame(PLAIN, SCENE, locus, pad=16)
