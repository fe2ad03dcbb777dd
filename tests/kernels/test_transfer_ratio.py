"""What an image shows of its blur's transfer function."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, expected_image
from jitterkit.kernels import transfer_ratio
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.optics import expand, flat_band, grid_for, obstructed_circle
from jitterkit.scene import Binary

P = 0.375
SCENE = Binary(5.0, 40.0, 0.1, 0.05, 3e6, 3.37)


@pytest.fixture(scope="module")
def image():
    # a telescope of its own, with a wider frame: in a narrow one the window's leaks exceed a hundredth
    pupil, band = obstructed_circle(0.125, 0.04, samples=64, noll=()), flat_band(530, 640, 3)
    otf = expand(pupil, band, grid_for(pupil, band, (48, 64), P, pad=16))
    return lambda locus: np.asarray(expected_image(Parameters(SCENE, locus), otf))


@pytest.mark.parametrize("angle", [0.0, 30.0, 75.0, 120.0])
def test_along_a_streak_the_ratio_is_its_sinc_and_across_it_is_one(image, angle):
    locus = Linear.of(0.7, angle)
    along, across = (
        transfer_ratio(
            image(locus), image(Stable.of()), P, angle + turn, variance=1.0, transfer=locus.transfer
        )
        for turn in (0, 90)
    )
    low = along.frequency < 0.9  # beyond, the optics leave a hundredth and the window's leaks show
    # the window is not blurred with the scene: a hundredth
    np.testing.assert_allclose(along.measured[low], along.fitted[low], atol=0.015)
    # within 20 degrees of the axis the projection is shorter by up to 6 %, on the mean by 2 %
    np.testing.assert_allclose(along.fitted[low], np.sinc(0.98 * 0.7 * along.frequency[low]), atol=0.03)
    # and across it a wedge sees up to sin 20° of the length, at the far side of a bin
    furthest = across.frequency + 0.5 * (across.frequency[1] - across.frequency[0])
    assert np.all(across.fitted > np.sinc(0.7 * np.sin(np.radians(20)) * furthest))
    assert np.all(across.measured[low] > 0.93)


def test_errors_are_honest(image, rng):
    locus, sharp = Mvn.of(0.15, 0.08, 50.0), image(Stable.of())
    blurred = image(locus)
    draws = [transfer_ratio(rng.poisson(blurred), sharp, P, 50.0, variance=blurred) for _ in range(60)]
    values, errors = (np.array([getattr(r, name)[:16] for r in draws]) for name in ("measured", "error"))
    # a standard deviation of 60 draws scatters by 1/sqrt(118) = 9 %: four times that
    np.testing.assert_allclose(values.std(0, ddof=1) / errors.mean(0), 1, atol=0.37)


def test_the_power_of_the_noise_is_taken_off(image, rng):
    sharp, noise = image(Stable.of()), 300.0
    draws = [
        transfer_ratio(sharp + rng.normal(0, noise, sharp.shape), sharp, P, 0.0, variance=noise**2)
        for _ in range(60)
    ]
    # the faintest bins shown have four times the noise's power: left in, it would add 12 %
    means, errors = (np.mean([getattr(r, name) for r in draws], axis=0) for name in ("measured", "error"))
    assert errors[-1] > 0.03
    np.testing.assert_array_less(np.abs(means**2 - 1), 4 * 2 * errors / np.sqrt(60) + errors**2)


def test_the_templates_flux_does_not_matter_with_a_model(image):
    locus = Linear.of(0.4, 10.0)
    args = {"variance": 1.0, "transfer": locus.transfer}
    one, other = (transfer_ratio(image(locus), k * image(Stable.of()), P, 10.0, **args) for k in (1, 3))
    # the noise is judged against the template: compare where both show
    n = min(len(one.measured), len(other.measured))
    np.testing.assert_allclose(one.measured[:n], other.measured[:n], rtol=1e-2)


def test_without_a_model_nothing_is_fitted_nor_scaled(image):
    ratio = transfer_ratio(2 * image(Stable.of()), image(Stable.of()), P, 0.0)
    assert ratio.fitted is None
    np.testing.assert_allclose(ratio.measured, 2, rtol=1e-9)
    assert np.all(ratio.error == 0)


def test_what_lies_below_the_noise_is_not_shown(image):
    sharp = image(Stable.of())
    clean, noisy = (transfer_ratio(sharp, sharp, P, 0.0, variance=v) for v in (1.0, 1e4))
    assert len(noisy.frequency) < len(clean.frequency)
    assert noisy.frequency.max() < 1.15  # the optics' cutoff
    with refused(ErrorCode.NO_SIGNAL, "30 degrees", error=UndeterminedError):
        transfer_ratio(sharp, sharp, P, 30.0, variance=1e12)


def test_holes_and_other_shapes_are_refused(image):
    sharp = image(Stable.of())
    holed = sharp.copy()
    holed[:3, 4] = np.nan
    with refused(ErrorCode.OUT_OF_RANGE, f"3 of {sharp.size}", error=ConfigurationError):
        transfer_ratio(holed, sharp, P, 0.0)
    with refused(ErrorCode.OUT_OF_RANGE, f"3 of {sharp.size}", error=ConfigurationError):
        transfer_ratio(sharp, holed, P, 0.0)
    with refused(ErrorCode.WRONG_SHAPE, (48, 63), (48, 64), error=ConfigurationError):
        transfer_ratio(sharp[:, 1:], sharp, P, 0.0)
