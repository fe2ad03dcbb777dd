"""What every kernel estimator must do; a new one is held to it by being in the registry."""

import equinox as eqx
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.estimators import ESTIMATORS, estimator
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.optics import expand, flat_band, grid_for, obstructed_circle
from jitterkit.scene import Binary

DRAWS = 60
FEWER = {"richardson-lucy": 10, "nnls": 20}  # thousands of updates, hundreds of solutions a frame
FOLDED = {"nnls", "richardson-lucy"}
"""A kernel that cannot be negative has moments that cannot: the mean of a normal variable folded at zero is
0.8 of its standard deviation above it, and a node on either side of the truth folds each; measured, 1.2."""
_image = eqx.filter_jit(expected_image)


def scene(theta=40.0):
    return Binary(5.0, theta, 0.1, 0.05, 3e6, 3.37)


def moments_of(locus):
    return np.asarray(locus.moments())


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize(
    "locus",
    [
        pytest.param(Stable.of(), marks=pytest.mark.slow),
        Mvn.of(0.08, 0.04, 50.0),
        pytest.param(Linear.of(0.2, 120.0), marks=pytest.mark.slow),
    ],
    ids=["stable", "mvn", "linear"],
)
def test_moments_are_unbiased_and_their_covariance_is_honest(name, locus, otf, rng):
    template = Parameters(scene(), Stable.of())
    image = np.asarray(_image(Parameters(scene(), locus), otf))
    draws = FEWER.get(name, DRAWS)
    estimates = [
        ESTIMATORS[name](Data(rng.poisson(image) + rng.normal(0, 3, image.shape), 9.0), template, otf)
        for _ in range(draws)
    ]
    values, errors = np.array([e.moments for e in estimates]), np.mean([e.errors for e in estimates], axis=0)
    # 4 standard errors of the mean; a fifth of an error is allowed for the normal's shape
    allowed = 1.2 if name in FOLDED else 0.2
    np.testing.assert_array_less(
        np.abs(values.mean(0) - moments_of(locus)), errors * (4 / np.sqrt(draws) + allowed)
    )
    # a standard deviation of 60 draws scatters by 1/sqrt(2*59) = 9 %: four times that.  Folding narrows
    scatter, margin = values.std(0, ddof=1) / errors, 4 / np.sqrt(2 * (draws - 1))
    assert np.all(scatter < 1 + margin)
    assert name in FOLDED or np.all(scatter > 1 - margin)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_flat_of_one_value_changes_nothing_but_the_unit(name, otf, rng):
    """What is counted is what was collected: blur and errors are those of the counts themselves."""
    faint = eqx.tree_at(lambda s: s.flux, scene(), 0.3 * scene().flux)
    counts = rng.poisson(_image(Parameters(faint, Mvn.of(0.08, 0.04, 50.0)), otf)) + rng.normal(
        0, 3, otf.grid.shape
    )
    counted = ESTIMATORS[name](Data(counts, 9.0), Parameters(faint, Stable.of()), otf)
    divided = Data(counts / 0.3, 9.0, response=0.3)
    found = ESTIMATORS[name](divided, Parameters(scene(), Stable.of()), otf)
    # digits that a single precision transform leaves, and where a search ends
    np.testing.assert_allclose(found.moments, counted.moments, rtol=0, atol=1e-3 * counted.errors.min())
    np.testing.assert_allclose(found.errors, counted.errors, rtol=1e-3)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_turning_the_sky_turns_the_moments(name, otf):
    found = []
    for turn in (0.0, 90.0):
        image = np.asarray(_image(Parameters(scene(40.0 + turn), Mvn.of(0.08, 0.03, 20.0 + turn)), otf))
        found.append(ESTIMATORS[name](Data(image), Parameters(scene(40.0 + turn), Stable.of()), otf).moments)
    sxx, sxy, syy = found[0]
    # the midpoint does not turn with the pair: a hundredth of the moments remains
    np.testing.assert_allclose(found[1], [syy, -sxy, sxx], atol=1e-4)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_noise_free_frame_gives_the_truth(name, otf):
    locus = Mvn.of(0.05, 0.02, 70.0)
    image = np.asarray(_image(Parameters(scene(), locus), otf))
    estimate = ESTIMATORS[name](Data(image), Parameters(scene(), Stable.of()), otf)
    # a tenth of the statistical error, the least that anyone would notice; the MTF ratio subtracts the
    # power of photon noise that is not there, and may be off by half an error; Richardson and Lucy stop
    # when they gain a tenth of a unit of deviance no more, a third of an error
    allowed = {"mtf": 0.5, "richardson-lucy": 0.4}.get(name, 0.1)
    np.testing.assert_array_less(np.abs(estimate.moments - moments_of(locus)), allowed * estimate.errors)


def test_the_score_estimator_attains_the_bound_and_the_mtf_ratio_twice_it(otf, rng):
    image = np.asarray(_image(Parameters(scene(), Stable.of()), otf))
    data = Data(rng.poisson(image), 0.0)
    template = Parameters(scene(), Stable.of())
    score, mtf = (ESTIMATORS[name](data, template, otf).errors for name in ("score", "mtf"))
    assert np.all(mtf > score)
    assert np.all(mtf < 3 * score)


def test_too_faint_a_frame_is_refused(otf):
    faint = Parameters(Binary(5.0, 0.0, 0.0, 0.0, 5.0, 3.37), Stable.of())
    with refused(ErrorCode.NO_SIGNAL, "0 frequencies", 10, error=UndeterminedError):
        ESTIMATORS["mtf"](Data(np.zeros(otf.grid.shape), 100.0), faint, otf)


def test_a_frame_too_small_for_a_window_is_refused():
    pupil, band = obstructed_circle(0.125, 0.04, samples=64, noll=()), flat_band(530, 640, 3)
    small = expand(pupil, band, grid_for(pupil, band, (20, 48), 0.375, pad=16))
    template = Parameters(scene(), Stable.of())
    with refused(ErrorCode.TOO_FEW, "32 pixels", 20, error=UndeterminedError):
        ESTIMATORS["mtf"](Data(np.asarray(expected_image(template, small))), template, small)


def test_an_unknown_name_lists_the_known_ones():
    with refused(ErrorCode.UNKNOWN_NAME, "'cepstrum'", ", ".join(ESTIMATORS), error=ConfigurationError):
        estimator("cepstrum")


@pytest.mark.parametrize("name", ESTIMATORS)
def test_masked_pixels_are_not_taken_for_a_sharper_image(name, otf):
    locus = Mvn.of(0.08, 0.04, 50.0)
    image = np.asarray(expected_image(Parameters(scene(), locus), otf))
    used = image < np.sort(image.ravel())[-6]  # the brightest pixels, as saturation takes them
    whole = ESTIMATORS[name](Data(image), Parameters(scene(), Stable.of()), otf)
    masked = ESTIMATORS[name](Data(image, 0.0, used), Parameters(scene(), Stable.of()), otf)
    # the fill is the template blurred by the estimate: a tenth of an error is left of it
    np.testing.assert_array_less(np.abs(masked.moments - whole.moments), 0.5 * whole.errors)
