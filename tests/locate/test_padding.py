"""Derivatives on a grid with less padding, against those on the whole grid in 64 bits."""

from dataclasses import replace

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, free_parameters, image_and_jacobian, to_vector
from jitterkit.likelihood import Data, deviance, normal_equations
from jitterkit.linearisation import relinearised_scoring
from jitterkit.locate.padding import MAY_MOVE, grid_for_derivatives
from jitterkit.loci import Mvn, Path
from jitterkit.optics import Anchor, AnchoredOptics, Grid, OpticalSystem, lines
from jitterkit.optics.colours import Colours
from jitterkit.precision import single
from jitterkit.scene import Binary
from jitterkit.scoring import Prior, fisher_scoring

SCALE, FRAME = 0.375, 64
STATE, CHANGE = np.zeros(7), np.array([1.0, -0.5, 0.3, 0.2, 0.7, 0.1, -1.0])


@pytest.fixture(scope="module")
def anchored(toliman):
    system = OpticalSystem(toliman, lines(585.0), Grid((FRAME, FRAME), SCALE))
    anchor = Anchor.at(system, STATE)
    return AnchoredOptics.about(system, anchor, 1e7)


def pair(off: float, flux: float) -> Parameters:
    """A pair off the middle by a share of the frame."""
    scene = Binary(6.0, 0.3, off * FRAME * SCALE, 0.0, flux, 0.3)
    return Parameters(scene, Mvn(np.array([0.04, 0.005, 0.02])), STATE, 2.0)


@pytest.mark.parametrize(("off", "flux"), [(0.0, 1e5), (0.0, 1e7), (0.2, 1e6), (0.4, 1e4)])
def test_errors_by_the_chosen_grid_are_those_of_the_whole_wherever_a_frame_may_have_its_stars(
    off, flux, anchored
):
    reference = pair(off, flux)
    grid = grid_for_derivatives(reference, anchored.nominal)
    assert grid is None or grid.fine_shape < anchored.nominal.grid.fine_shape
    assert (grid is None) is (off == 0.4)
    if grid is None:
        return
    optics, state = replace(anchored, coarse=single(anchored.anchor.within(grid))), STATE + CHANGE
    for move in (-1, 1):
        where = reference.shifted(move * MAY_MOVE * SCALE, MAY_MOVE * SCALE)
        where = replace(where, aberrations=state)
        whole, otf = anchored.otf(state), optics.otf(state)
        image = np.asarray(expected_image(where, whole))
        data = Data(image, np.full(image.shape, 9.0), np.ones(image.shape, bool))
        _, free = free_parameters(where, otf)
        exact = normal_equations(where, whole, data, free)
        here = normal_equations(where, otf, data, free, exact=False)
        root = np.linalg.cholesky(np.linalg.inv(exact.information))
        shares = np.linalg.eigvalsh(root.T @ here.information @ root)
        assert np.abs(shares - 1).max() < 2e-4
        assert np.abs(root.T @ here.score).max() < 1e-3  # sigmas; the image is as good as exact


def chi(image, right) -> float:
    """Distance of two images, in sigmas of all photons together."""
    return float(np.sqrt(np.sum((np.asarray(image) - right) ** 2 / (np.asarray(right) + 9.0))))


@pytest.fixture(scope="module", params=[pytest.param("wavefront", marks=pytest.mark.slow), "colours and B"])
def both(request, toliman):
    """Optics of a frame with slopes on the whole grid, and on the chosen one; parameters near their state."""
    system, reference = OpticalSystem(toliman, lines(585.0), Grid((FRAME, FRAME), SCALE)), pair(0.0, 1e6)
    if request.param != "wavefront":
        known = Colours((0.5, -0.5), 0.3, wavelength_err=5e-4)
        spectrum = lines(540.0, 585.0, 620.0)
        system = replace(system, spectrum=spectrum, colours=known, plate_scale_sigma=1e-4, of_b=("noll4",))
    reference = reference.completed(system.nominal)
    optics = AnchoredOptics.about(system, Anchor.at(system, STATE), 1e6)
    coarse = single(optics.anchor.within(grid_for_derivatives(reference, optics.nominal)))
    names = system.nominal.names
    state = np.concatenate([CHANGE, np.zeros(len(names) - len(CHANGE))])
    state += 0.5 * np.array([name == "noll4_b" for name in names])
    rng = np.random.default_rng(4)
    step = np.array([1e-6 if name == "plate_scale_shift" else 0.2 for name in names]) * rng.normal(
        size=len(names)
    )
    here = replace(reference, aberrations=state + step)
    return optics, replace(optics, coarse=coarse), state, here


def test_away_from_their_state_optics_with_slopes_apart_give_the_same_image(both):
    *optics, state, here = both
    whole, apart = (one.otf(state) for one in optics)
    assert apart.coarse is not None
    assert apart.slopes.shape[0] == len(whole.names) - len(STATE) - len(whole.of_b)
    at_state = np.asarray(expected_image(replace(here, aberrations=state), whole))
    image = np.asarray(expected_image(here, whole))
    assert chi(at_state, image) > 1.0
    assert chi(expected_image(here, apart), image) < 2e-3
    free = free_parameters(here, whole)[1]
    (_, slow), (_, fast) = (image_and_jacobian(here, otf, free) for otf in (whole, apart))
    for right, slope in zip(np.asarray(slow), np.asarray(fast), strict=True):
        assert np.linalg.norm(slope - right) < 2e-3 * np.linalg.norm(right)
    assert apart.blind() == whole.blind()


@pytest.mark.parametrize("hold", [(), ("noll5",)])
@pytest.mark.parametrize("away", [1.0, 10.0])
def test_fits_with_slopes_apart_end_where_those_on_the_whole_grid_do(both, away, hold):
    whole, apart, _, truth = both
    image = np.asarray(expected_image(truth, whole.otf(truth.aberrations)))
    rng = np.random.default_rng(7)
    data = Data(rng.poisson(image) + rng.normal(0, 3.0, image.shape), 9.0, rng.random(image.shape) > 0.1)
    free = free_parameters(truth, whole.nominal, hold)[1]
    given = data, free, Prior.none(len(free))
    strict = {"max_error": 1e-3, "tolerance": 1e-6}
    right, *_ = relinearised_scoring(truth, whole.otf(truth.aberrations), whole, *given, **strict)
    errors = np.sqrt(np.diag(np.linalg.inv(right.information)))
    vector, unravel = to_vector(right.parameters)
    start = unravel(vector.at[np.array(free)].add(away * errors * rng.choice([-1, 1], len(free))))
    end, _, iterations, *_ = relinearised_scoring(start, apart.otf(start.aberrations), apart, *given)
    assert right.converged
    assert end.converged
    assert iterations < 25
    off = (to_vector(end.parameters)[0] - to_vector(right.parameters)[0])[np.array(free)] / errors
    assert np.sqrt(np.mean(off**2)) < 0.01
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(end.information))), errors, rtol=0.01)


def test_a_few_steps_of_a_crooked_path_end_with_the_objective_of_their_image(both):
    """By slopes that were computed before the last step it was off by 0.2, and another bend was chosen."""
    whole, apart, state, truth = both
    bent = truth.with_locus(Path.of([(-0.3, -0.2), (0.1, 0.2), (0.3, -0.1), (0.2, 0.3)]))
    image = np.asarray(expected_image(bent, whole.otf(truth.aberrations)))
    data = Data(np.random.default_rng(9).poisson(image) + 0.0, 9.0)
    start = replace(bent, aberrations=state).with_locus(Path.near((0.05, 0.01, 0.03)))
    free = free_parameters(start, whole.nominal)[1]
    prior = Prior.none(len(free))
    ends = [fisher_scoring(start, one.otf(state), data, free, prior, max_steps=4) for one in (whole, apart)]
    for end in ends:
        right = float(deviance(end.parameters, whole.otf(state), data))
        assert float(end.objective) == pytest.approx(right, abs=0.01)
    assert float(ends[1].objective) == pytest.approx(float(ends[0].objective), abs=0.05)


def test_evaluations_by_new_slopes_are_no_steps(both):
    whole, apart, state, truth = both
    image = np.asarray(expected_image(truth, whole.otf(truth.aberrations)))
    data = Data(np.random.default_rng(9).poisson(image) + 0.0, 9.0)
    free = free_parameters(truth, whole.nominal)[1]
    errors = np.sqrt(
        np.diag(np.linalg.inv(normal_equations(truth, whole.otf(state), data, free).information))
    )
    vector, unravel = to_vector(replace(truth, aberrations=state))
    start = unravel(vector.at[np.array(free)].add(3 * errors))
    given = data, free, Prior.none(len(free))
    right, end = (fisher_scoring(start, one.otf(start.aberrations), *given) for one in (whole, apart))
    assert right.converged
    assert end.converged
    assert int(end.iterations) <= int(right.iterations) + 4  # with those that only renew slopes: six or seven
