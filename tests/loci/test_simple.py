"""One program for all simple loci: the same transfer functions and the same fits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit import scoring
from jitterkit.forward import GRADIENT, Parameters, expected_image, free_parameters, to_vector
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


@pytest.mark.parametrize("locus", LOCI, ids=lambda locus: type(locus).__name__)
def test_it_is_the_locus_with_all_derivatives(locus):
    simple, size = AnySimple.instead_of(locus), len(locus.names)
    assert np.asarray(simple.transfer(FX, FY)) == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=2e-14)
    assert np.asarray(simple.moments()) == pytest.approx(np.asarray(locus.moments()), abs=1e-17)
    assert simple.describe() == locus.describe()
    coords = jnp.asarray(simple.coords)
    for derivative in (jax.jacfwd, jax.jacrev):  # the information's and the score's
        slope = np.asarray(derivative(lambda c: simple.at(c).transfer(FX, FY))(coords))
        bend = np.asarray(derivative(lambda c: simple.at(c).moments())(coords))
        assert not np.any(slope[..., size:])
        assert not np.any(bend[..., size:])
        if size:
            own = np.asarray(jax.jacfwd(lambda c: locus.at(c).transfer(FX, FY))(jnp.asarray(locus.coords)))
            assert slope[..., :size] == pytest.approx(own, abs=2e-14 * np.abs(own).max())
            own = jax.jacfwd(lambda c: locus.at(c).moments())(jnp.asarray(locus.coords))
            assert bend[..., :size] == pytest.approx(np.asarray(own), abs=1e-16)


def test_a_locus_with_a_shape_of_its_own_is_none():
    assert AnySimple.instead_of(PartialShm.of(0.3)) is None
    assert AnySimple.instead_of(AnySimple.instead_of(Mvn.of(0.3))) is None


@pytest.fixture
def programs(monkeypatch):
    """Counts how often a scoring loop is traced: once for each program."""
    traced = []
    honest = scoring.information_at

    def counted(parameters, *rest):
        traced.append(type(parameters.locus))
        return honest(parameters, *rest)

    monkeypatch.setattr(scoring, "information_at", counted)
    return traced


def test_fits_with_all_of_them_share_a_program_and_end_as_with_their_own(otf, programs):
    star = Star(0.2, -0.1, 1e6)
    truth = Parameters(star, Linear.of(0.4, 30.0), [2.0, -2.0])
    data = Data(np.random.default_rng(5).poisson(np.asarray(expected_image(truth, otf))), 0.0)
    limits = np.asarray(50), np.asarray(1e-6), np.asarray(0.0025)
    for locus in LOCI[:5]:
        start = Parameters(star, type(locus).near(truth.locus.moments()), [1.0, -1.0])
        free = free_parameters(start, otf, GRADIENT)[1]
        prior = Prior.none(len(free))
        shared = scoring.fisher_scoring(start, otf, data, free, prior, tolerance=1e-6)
        own = scoring._scoring_loop(start, otf, data, free, prior, np.zeros(2 * prior.mean.shape), *limits)
        assert type(shared.parameters.locus) is type(locus)
        assert shared.parameters.locus.coords.shape == locus.coords.shape
        errors = np.sqrt(np.diag(np.linalg.inv(own.information)))
        (there, _), (here, _) = to_vector(shared.parameters), to_vector(own.parameters)
        # each stops within 1e-6 of an error
        assert np.asarray(there - here)[list(free)] / errors == pytest.approx(0, abs=5e-6)
        assert float(shared.objective) == pytest.approx(float(own.objective), rel=1e-12)
        for one, other in ((shared.information, own.information), (shared.curvature, own.curvature)):
            assert one / np.sqrt(np.outer(np.diag(other), np.diag(other))) == pytest.approx(
                np.asarray(other) / np.sqrt(np.outer(np.diag(other), np.diag(other))), abs=1e-5
            )
        assert shared.score.shape == own.score.shape
    assert programs.count(AnySimple) == 1
