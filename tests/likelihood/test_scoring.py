"""Fisher scoring: where it ends, and that nothing on the way spoils it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from refusals import refused
from scipy.optimize import minimize

from jitterkit.errors import ErrorCode
from jitterkit.forward import GRADIENT, Parameters, expected_image, free_parameters, to_vector
from jitterkit.likelihood import Data, deviance, deviance_and_score, normal_equations
from jitterkit.linearisation import Losing, Stall, _approach
from jitterkit.loci import Linear, Mvn, PartialShm, Stable
from jitterkit.metric import Prior
from jitterkit.optics import expand, flat_band, grid_for, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.scoring import fisher_scoring
from jitterkit.shutter import Drifting

SCENE = Binary(4.0, 40.0, 0.2, -0.1, 1e6, 2.0)


@pytest.fixture(scope="module")
def truth():
    return Parameters(SCENE, Mvn.of(0.1, 0.05, 30.0), [2.0, -2.0])


@pytest.fixture(scope="module")
def data(truth, otf):
    return Data(np.random.default_rng(5).poisson(np.asarray(expected_image(truth, otf))), 0.0)


def free_of(parameters, otf):
    return free_parameters(parameters, otf, GRADIENT)[1]


def test_it_ends_at_the_maximum_that_another_optimiser_finds(truth, otf, data):
    start = Parameters(Binary(4.2, 43.0, 0.0, 0.0, 9e5, 1.7), Mvn.of(0.05), [0.0, 0.0])
    free = free_of(start, otf)
    end = fisher_scoring(start, otf, data, free, Prior.none(len(free)))
    assert bool(end.converged)
    vector, unravel = to_vector(end.parameters)
    errors = np.sqrt(np.diag(np.linalg.inv(end.information)))

    @jax.jit
    def deviance_at(offset):
        return deviance(unravel(vector.at[: len(free)].add(offset * errors)), otf, data)

    def cost(offset):
        return float(deviance_at(offset))

    best = minimize(cost, np.full(len(free), 0.02), method="BFGS", options={"gtol": 1e-3})
    # BFGS with finite differences stops within about gtol of the optimum, in standard errors
    np.testing.assert_allclose(best.x, 0, atol=0.02)
    assert float(end.objective) <= best.fun + 1e-5


def test_a_start_at_zero_jitter_is_as_good_as_any(truth, otf, data):
    ends = []
    for locus in (Mvn(jnp.zeros(3)), Mvn.of(0.2, 0.2), Mvn.of(0.1, 0.05, 30.0)):
        start = Parameters(truth.scene, locus, truth.aberrations)
        free = free_of(start, otf)
        ends.append(fisher_scoring(start, otf, data, free, Prior.none(len(free))).parameters.locus.coords)
    # each stops within 1e-4 standard errors (2e-4 arcsec² here); allow ten times that
    np.testing.assert_allclose(ends, [ends[0]] * 3, atol=1e-3 * 2e-4)


def test_a_prior_that_is_certain_decides(truth, otf, data):
    start = Parameters(truth.scene, truth.locus, truth.aberrations)
    free = free_of(start, otf)
    precision = np.zeros((len(free), len(free)))
    precision[0, 0] = 1e-9**-2
    end = fisher_scoring(
        start, otf, data, free, Prior(jnp.zeros(len(free)).at[0].set(4.01), jnp.asarray(precision))
    )
    assert float(end.parameters.scene.separation) == pytest.approx(4.01, abs=1e-8)


@pytest.mark.parametrize("wrong", [1e-3, 1e3, -1.0, np.nan])
def test_information_that_is_wrong_is_renewed_and_changes_no_end(truth, otf, data, wrong):
    start = Parameters(Binary(4.02, 40.3, 0.21, -0.1, 9.8e5, 1.95), Mvn.of(0.12, 0.05, 30.0), [3.0, -2.0])
    free = free_of(start, otf)
    right = fisher_scoring(start, otf, data, free, Prior.none(len(free)), tolerance=1e-6)
    end = fisher_scoring(
        start, otf, data, free, Prior.none(len(free)), tolerance=1e-6, known=wrong * right.information
    )
    assert bool(end.converged)
    errors = np.sqrt(np.diag(np.linalg.inv(right.information)))
    one, other = (np.asarray(to_vector(e.parameters)[0])[list(free)] for e in (right, end))
    np.testing.assert_allclose((one - other) / errors, 0, atol=3e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(end.information))), errors, rtol=0.01)


def test_without_errors_it_ends_at_the_same_place_with_information_that_served_a_step(truth, otf, data):
    start = Parameters(Binary(4.05, 40.5, 0.15, -0.05, 9e5, 1.9), Mvn.of(0.2, 0.2), [1.0, -1.0])
    free = free_of(start, otf)
    common = start, otf, data, free, Prior.none(len(free))
    right, quick = fisher_scoring(*common), fisher_scoring(*common, errors=False)
    errors = np.sqrt(np.diag(np.linalg.inv(right.information)))
    (there, _), (here, _) = to_vector(quick.parameters), to_vector(right.parameters)
    np.testing.assert_allclose(np.asarray(there - here)[np.array(free)] / errors, 0, atol=1e-3)
    assert not np.array_equal(quick.information, right.information)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(quick.information))), errors, rtol=0.25)


@pytest.mark.parametrize(
    "parameters",
    [
        Parameters(SCENE, PartialShm.of(0.4, 30.0, 0.7, 20.0), [2.0, -2.0], 3.0),
        Parameters(SCENE, Mvn(jnp.zeros(3)), [2.0, -2.0], shutter=Drifting(1e-3, (0.5, -0.8))),
        Parameters(SCENE, Linear(jnp.zeros(2)), [2.0, -2.0], diffusion=0.002),
    ],
    ids=["partial", "rolling", "still"],
)
def test_the_adjoint_gives_the_score_that_derivatives_of_the_image_do(parameters, otf, data):
    full = np.zeros(data.used.shape, bool)
    full[20:24, 20:22] = True
    data = Data(data.electrons, 4.0, ~full, response=0.8, ceiling=2e4, full=full)
    free = free_parameters(parameters, otf, hold=())[1]
    slow, fast = (normal_equations(parameters, otf, data, free, exact=exact) for exact in (True, False))
    errors = np.sqrt(np.diag(np.linalg.inv(slow.information)))
    vector, unravel = to_vector(parameters)

    @jax.jit
    def by_adjoint(values):
        return deviance_and_score(lambda v: unravel(vector.at[np.array(free)].set(v)), values, otf, data)

    deviance, score = by_adjoint(vector[np.array(free)])
    assert float(deviance) == pytest.approx(float(slow.deviance), rel=1e-13)
    np.testing.assert_allclose(score * errors, slow.score * errors, rtol=1e-9, atol=1e-9)
    assert float(fast.deviance) == pytest.approx(float(slow.deviance), rel=1e-13)
    largest = np.max(np.abs(slow.score * errors))
    np.testing.assert_allclose(fast.score * errors, slow.score * errors, atol=1e-5 * largest)
    scale = np.sqrt(np.diag(slow.information))
    np.testing.assert_allclose((fast.information - slow.information) / np.outer(scale, scale), 0, atol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(fast.information))), errors, rtol=0.005)


def test_far_starts_do_not_leave_the_domain(truth, otf, data):
    start = Parameters(Binary(4.0, 40.0, 0.2, -0.1, 1.0, 500.0), Mvn(jnp.zeros(3)), [0.0, 0.0])
    free = free_of(start, otf)
    end = fisher_scoring(start, otf, data, free, Prior.none(len(free)), max_steps=200)
    assert float(end.parameters.scene.flux) > 0
    assert float(end.parameters.scene.contrast) > 0
    assert np.isfinite(float(end.objective))


def test_a_start_without_an_image_ends(truth, otf, data):
    start = Parameters(Binary(4.0, 40.0, 0.2, -0.1, np.nan, 2.0), truth.locus, truth.aberrations)
    free = free_of(start, otf)
    end = fisher_scoring(start, otf, data, free, Prior.none(len(free)))
    assert not bool(end.converged)
    assert int(end.iterations) == 50


def test_held_parameters_do_not_move(truth, otf, data):
    start = Parameters(Binary(4.1, 40.0, 0.2, -0.1, 1e6, 2.0), Stable.of(), [1.0, 1.0], 0.5)
    end = fisher_scoring(start, otf, data, (0, 4), Prior.none(2))
    before, after = np.asarray(to_vector(start)[0]), np.asarray(to_vector(end.parameters)[0])
    held = [i for i in range(len(before)) if i not in (0, 4)]
    np.testing.assert_array_equal(before[held], after[held])
    assert before[0] != after[0]


def test_an_aberration_whose_sign_the_image_cannot_distinguish_is_not_fitted():
    # a telescope of its own: the common one has no even aberrations, and noll 4 and 5 are what is tested
    pupil, band = obstructed_circle(0.125, 0.04, samples=64, noll=(4, 5, 7)), flat_band(530, 640, 3)
    otf = expand(pupil, band, grid_for(pupil, band, (32, 32), 0.375, pad=8))
    assert otf.blind() == ("noll4", "noll5")
    focused = Parameters(Binary(4.0, 40.0, 0.2, -0.1, 1e6, 2.0), Stable.of(), [0.0, 0.0, 0.0])
    names, _ = free_parameters(focused, otf)
    assert "noll7" in names
    assert "noll4" not in names
    # out of focus the sign shows
    defocused = expand(pupil, band, otf.grid, [20.0, 0.0, 0.0])
    assert "noll4" not in defocused.blind()


def test_holding_what_does_not_exist_is_refused(truth, otf):
    with refused(ErrorCode.UNKNOWN_NAME, "'focus'", "separation"):
        free_parameters(truth, otf, hold=("focus",))


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_it_settles_in_32_bits_where_rounding_hides_every_step(seed, otf):
    # Ten roundings of a deviance of a thousand are a step of 0.035 errors squared.
    jax.clear_caches()
    with jax.enable_x64(False):
        otf = jax.tree.map(lambda values: jnp.asarray(np.asarray(values)), otf)  # rounded to 32 bits
        bright = Parameters(Binary(4.0, 40.0, 0.2, -0.1, 1e8, 2.0), Linear.of(0.6, 30.0), [0.0, 0.0])
        image = np.maximum(np.asarray(expected_image(bright, otf), float), 0.0)
        counts = Data(np.random.default_rng(seed).poisson(image), 0.0)
        free = free_of(bright, otf)
        end = fisher_scoring(bright, otf, counts, free, Prior.none(len(free)))
        assert bool(end.converged)
        error = float(np.linalg.inv(np.asarray(end.information, float))[0, 0]) ** 0.5
        assert abs(float(end.parameters.scene.separation) - 4.0) < 4 * error


@pytest.mark.parametrize(
    ("levels", "hopeless"),
    [
        ((698.0, 638.0, 617.0, 602.0), True),  # stars of a field by another telescope
        ((50.0, 49.0, 20.0, 5.0), False),  # one slow round
        ((50.0, 20.0, 5.0, 4.9), False),
        ((1.6, 1.56, 1.52, 1.505), False),  # slow, but near
    ],
)
def test_rounds_that_do_not_come_nearer_in_time_are_hopeless(levels, hopeless):
    stall = Stall(levels[0])
    told = [stall.is_hopeless(level, left) for level, left in zip(levels[1:], (6, 5, 4), strict=True)]
    assert told == [False, hopeless, hopeless]


@pytest.mark.parametrize(
    ("deviances", "rival", "certain"),
    [
        ((5318.8, 5288.2), 4564.4, [False, True]),  # a line in place of two stars ended at 5329.9
        ((6162.6, 9498.1, 5730.7, 5826.8), 4607.3, [False, False, False, True]),  # an ellipse, at 5839.5
        ((4715.9, 4704.8), 4564.4, [False, True]),  # a part of a vibration, at 4683.0
        ((4559.1, 4561.8, 4560.7), 4554.4, [False, False, False]),  # a smear: it may win
        ((4644.0, 4644.0), 4554.4, [False, False]),  # no more than priors may make up for
        ((4878.8, 4871.0), 5042.5, [False, False]),  # a path is better than the pair
        ((4878.8, 4871.0), np.inf, [False, False]),
        ((np.nan, 4871.0), 4000.0, [False, False]),
    ],
)
def test_a_fit_that_settles_far_above_another_reading_has_lost(deviances, rival, certain):
    losing = Losing(rival)
    assert [losing.is_certain(deviance) for deviance in deviances] == certain


@pytest.mark.parametrize(
    ("misses", "approach"),
    [
        ((14.1, 97.8, 68.7), True),  # too early to say
        ((14.1, 97.8, 68.7, 167.0), False),
        ((3.87, 4.68, 5.94, 5.74), False),
        ((1.18, 10.4, 15.7, 0.5), True),
        ((298.0, 82.3, 18.3, 5.8, 10.7), True),
    ],
)
def test_maxima_approach_each_other_if_the_best_of_two_rounds_halves_that_before(misses, approach):
    assert _approach(list(misses)) == approach


@pytest.mark.parametrize("free", [(1, 0), (0, 0), (0, 4, 2)])
def test_positions_that_do_not_ascend_are_refused(truth, otf, data, free):
    """Parameters are put together in pieces, from first to last: others would swap their values."""
    with refused(ErrorCode.MALFORMED, *free):
        fisher_scoring(truth, otf, data, free, Prior.none(len(free)))
