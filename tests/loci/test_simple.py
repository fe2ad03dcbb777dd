"""One program for all simple loci: the same transfer functions and the same fits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit import scoring, scoring_loop
from jitterkit.forward import GRADIENT, Parameters, expected_image, free_parameters, image, to_vector
from jitterkit.likelihood import Data
from jitterkit.loci import Ellipse, Linear, Lissajous, Mvn, PartialShm, Shm, Stable
from jitterkit.loci.simple import AnySimple
from jitterkit.metric import Prior
from jitterkit.scene import Star

LOCI = [
    Stable.of(),
    Mvn.of(0.3, 0.1, 20.0),
    Linear.of(0.7, 33.0),
    Shm.of(0.6, 111.0),
    Ellipse.of(0.4, 0.2, 15.0),
    Lissajous.of(0.3, 0.2, 40.0),
]
FX, FY = np.linspace(0, 2, 21)[None, :], np.linspace(-2, 2, 31)[:, None]


def slopes_of(locus, derivative):
    """Derivatives of the transfer function and of the moments, by one compiled program."""
    both = jax.jit(derivative(lambda c: (locus.at(c).transfer(FX, FY), locus.at(c).moments())))
    return lambda coords: tuple(map(np.asarray, both(coords)))


@pytest.mark.parametrize("locus", LOCI, ids=lambda locus: type(locus).__name__)
def test_the_common_form_has_the_values_and_derivatives_of_the_locus(locus):
    simple, size = AnySimple.instead_of(locus), len(locus.names)
    assert np.asarray(simple.transfer(FX, FY)) == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=2e-14)
    assert np.asarray(simple.moments()) == pytest.approx(np.asarray(locus.moments()), abs=1e-17)
    assert simple.describe() == locus.describe()
    coords = jnp.asarray(simple.coords)
    for derivative in (jax.jacfwd, jax.jacrev):  # the information's and the score's
        slope, bend = slopes_of(simple, derivative)(coords)
        assert not np.any(slope[..., size:])
        assert not np.any(bend[..., size:])
        if size:
            own, own_bend = slopes_of(locus, jax.jacfwd)(jnp.asarray(locus.coords))
            assert slope[..., :size] == pytest.approx(own, abs=2e-14 * np.abs(own).max())
            assert bend[..., :size] == pytest.approx(own_bend, abs=1e-16)


def test_a_locus_with_a_shape_of_its_own_is_none():
    assert AnySimple.instead_of(PartialShm.of(0.3)) is None
    assert AnySimple.instead_of(AnySimple.instead_of(Mvn.of(0.3))) is None


@pytest.fixture
def programs(monkeypatch):
    """List the kinds of locus for which a scoring loop is traced: one for each program."""
    traced = []
    original = scoring_loop.information_at

    def noted(parameters, *rest):
        traced.append(type(parameters.locus))
        return original(parameters, *rest)

    monkeypatch.setattr(scoring_loop, "information_at", noted)
    return traced


@pytest.fixture
def data(otf):
    truth = Parameters(Star(0.2, -0.1, 1e6), Linear.of(0.4, 30.0), [2.0, -2.0])
    return Data(np.random.default_rng(5).poisson(np.asarray(expected_image(truth, otf))), 0.0)


def start_of(locus):
    return Parameters(Star(0.2, -0.1, 1e6), locus, [1.0, -1.0])


@pytest.mark.parametrize(
    "loci",
    [
        pytest.param(LOCI[:3], id="stable, normal, streak"),
        pytest.param([LOCI[0], *LOCI[3:5]], id="stable, vibration, ellipse", marks=pytest.mark.slow),
    ],
)
def test_fits_with_all_of_them_share_a_program_and_end_as_with_their_own(loci, otf, data, programs):
    """Each of their own programs takes more than a second to compile."""
    limits = np.asarray(50), np.asarray(1e-6), np.asarray(scoring_loop.FINAL_ERROR)
    for locus in loci:
        start = start_of(type(locus).near(Linear.of(0.4, 30.0).moments()))
        free = free_parameters(start, otf, GRADIENT)[1]
        prior = Prior.none(len(free))
        if locus is not LOCI[0]:
            programs.clear()
        shared = scoring.fisher_scoring(start, otf, data, free, prior, tolerance=1e-6)
        assert locus is LOCI[0] or not programs
        own = scoring_loop.scoring_loop(
            start, otf, data, free, prior, np.zeros(2 * prior.mean.shape), *limits
        )
        assert type(shared.parameters.locus) is type(locus)
        assert shared.parameters.locus.coords.shape == locus.coords.shape
        errors = np.sqrt(np.diag(np.linalg.inv(own.information)))
        (there, _), (here, _) = to_vector(shared.parameters), to_vector(own.parameters)
        # each stops within 1e-6 of an error
        assert np.asarray(there - here)[list(free)] / errors == pytest.approx(0, abs=5e-6)
        assert float(shared.objective) == pytest.approx(float(own.objective), rel=1e-12)
        for one, other in ((shared.information, own.information), (shared.curvature, own.curvature)):
            size = np.sqrt(np.outer(np.diag(other), np.diag(other)))
            assert one / size == pytest.approx(np.asarray(other) / size, abs=1e-5)
        assert shared.score.shape == own.score.shape


def test_a_ceiling_that_is_left_out_makes_no_other_program(otf, data, programs):
    start = start_of(Mvn.of(0.1))
    free = free_parameters(start, otf, GRADIENT)[1]
    trimmed = Data(data.electrons, data.read_variance, ceiling=1e9)
    assert trimmed.trims
    prior = Prior.none(len(free))
    whole = scoring.fisher_scoring(start, otf, data, free, prior)
    programs.clear()
    assert float(scoring.fisher_scoring(start, otf, trimmed, free, prior).objective) == float(whole.objective)
    assert not programs


def test_images_of_all_of_them_share_a_program(otf, monkeypatch):
    traced = []
    original = image.background_of
    monkeypatch.setattr(image, "background_of", lambda *given: traced.append(0) or original(*given))
    for locus in (LOCI[0], *LOCI):
        traced.clear()
        expected_image(Parameters(Star(0.3, 0.1, 2e6), locus, [1.0, -1.0], gradient=[1.0, 2.0]), otf)
    assert not traced


def test_a_fit_may_be_mapped_over_priors_and_known_information(otf, data):
    start = start_of(Linear.of(0.4, 30.0))
    free = free_parameters(start, otf, GRADIENT)[1]
    none = Prior.none(len(free))
    alone = scoring.fisher_scoring(start, otf, data, free, none)

    def fit(known, precision):
        prior = Prior(none.mean, precision)
        return scoring.fisher_scoring(start, otf, data, free, prior, known=known).objective

    some = jnp.stack([alone.information, 2 * alone.information]), jnp.zeros((2, len(free), len(free)))
    assert np.asarray(jax.vmap(fit)(*some)) == pytest.approx(float(alone.objective), rel=1e-9)
