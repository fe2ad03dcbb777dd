"""Laplace's evidence: priors that integrate to one, and Occam's factor."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from jitterkit.forward import Parameters
from jitterkit.loci import Ellipse, Linear, Mvn, PartialShm, Path, Shm, Smear, Tones
from jitterkit.refit.boundary import minor_variance, regularizing_priors
from jitterkit.refit.evidence import log_evidence
from jitterkit.refit.result import FitResult, Status
from jitterkit.scene import Binary

SCENE = Binary(5.0, 140.0, 0.0, 0.0, 1e6, 3.0)


def fitted(name, locus, sigma, objective=0.0):
    """A fit of nothing but the jitter, every coordinate to within sigma."""
    covariance = np.eye(len(locus.names)) * sigma**2
    parameters = Parameters(SCENE, locus, ())
    return FitResult(
        Status.OK, "", (), name, parameters, locus.names, covariance=covariance, objective=objective
    )


def streak(variance, log_total, twice):
    size = jnp.exp(log_total) / variance
    return jnp.stack([size * jnp.cos(twice), size * jnp.sin(twice)])


def elliptical(log_total, e1, e2):
    half = jnp.exp(log_total) / 2
    return jnp.stack([half * (1 + e1), half * e2, half * (1 - e1)])


def tones(log_total, share, twice1, twice2):
    parts = [(share, twice1), (1 - share, twice2)]
    return jnp.concatenate([streak(1 / 8, log_total + jnp.log(s), twice) for s, twice in parts])


def smear(log_total, share, twice, e1, e2):
    rest = elliptical(log_total + jnp.log(1 - share), e1, e2)
    return jnp.concatenate([streak(1 / 12, log_total + jnp.log(share), twice), rest])


def partial(log_total, direction):
    return jnp.exp(log_total / 2) * jnp.stack([jnp.cos(direction), jnp.sin(direction)])


@pytest.mark.parametrize(
    ("name", "kind", "coords", "at", "density"),
    [  # densities per unit of ln T of what the prior is uniform in; an exchange or a mirror doubles them
        ("linear", Linear, lambda *q: streak(1 / 12, *q), (-4.0, 0.7), 1 / (2 * np.pi)),
        ("shm", Shm, lambda *q: streak(1 / 8, *q), (-4.0, 0.7), 1 / (2 * np.pi)),
        ("ellipse", Ellipse, elliptical, (-4.0, 0.5, -0.3), 1 / np.pi),
        ("mvn", Mvn, elliptical, (-4.0, 0.5, -0.3), 0.5 / np.pi),
        ("tones", Tones, tones, (-4.0, 0.6, 0.7, 2.5), 2 / (2 * np.pi) ** 2),
        ("smear", Smear, smear, (-4.0, 0.6, 0.7, 0.5, -0.3), 1 / (2 * np.pi) / np.pi),
    ],
)
def test_every_prior_is_uniform_in_what_it_says(name, kind, coords, at, density):
    at = jnp.asarray(at)
    jacobian = jax.jacfwd(lambda q: coords(*q))(at)
    template = kind.near(jnp.array([0.1, 0.02, 0.05])) if name != "tones" else Tones.of(1.0, 0.0, 1.0, 50.0)
    locus = template.at(coords(*at))
    sigma = 1e-9
    evidence = log_evidence(fitted(name, locus, sigma))
    # a density turns by its Jacobian; the posterior is (2 pi)^(k/2) sigma^k wide
    expected = np.log(density) - np.linalg.slogdet(jacobian)[1] + len(at) * np.log(np.sqrt(2 * np.pi) * sigma)
    assert evidence == pytest.approx(expected, abs=1e-6)


def test_a_partial_vibration_points_anywhere_and_two_sets_of_numbers_are_one_motion():
    locus = PartialShm.of(0.4, 30.0, 0.7, 20.0)
    total = float(np.sum(np.asarray(locus.coords[:2]) ** 2))
    jacobian = jax.jacfwd(lambda q: partial(*q))(jnp.array([np.log(total), np.radians(30.0)]))
    sigma = 1e-9
    density = np.log(2 / (2 * np.pi)) - np.linalg.slogdet(jacobian)[1]
    density -= sum(np.log(np.sqrt(2 * np.pi) * width) for _, width in regularizing_priors(locus).values())
    expected = density + 4 * np.log(np.sqrt(2 * np.pi) * sigma)
    assert log_evidence(fitted("partial", locus, sigma)) == pytest.approx(expected, abs=1e-6)


def regularized(steps, sigma):
    """A fit of a path whose objective is the regularizing prior's quadratic form alone."""
    locus = Path(steps)
    (_, width), *_ = regularizing_priors(locus).values()
    return fitted("path", locus, sigma, float(np.sum(np.square(steps))) / width**2)


def test_paths_have_one_unit_of_prior_in_each_unit_of_ln_size(rng):
    # Steps in a direction even over the sphere, |S5| = pi³, with ln T even over one unit: at one shape
    # d ln T = 2 d ln r, so that their density is 2/(pi³ r⁶).  The mean of the prior over it is one.
    ratios = []
    for steps in rng.standard_normal((1000, 6)):
        sxx, _, syy = np.asarray(Path(steps).moments())
        steps *= np.exp(rng.uniform(0, 0.5)) * 0.1 / np.sqrt(sxx + syy)
        sigma = 1e-9
        # two sets of steps are one image; the posterior is (2 pi)³ sigma⁶ wide
        prior = log_evidence(regularized(steps, sigma)) - np.log(2) - 6 * np.log(np.sqrt(2 * np.pi) * sigma)
        ratios.append(np.exp(prior) * np.pi**3 * np.sum(steps**2) ** 3 / 2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * np.std(ratios) / np.sqrt(len(ratios)))
    assert (
        np.std(ratios) < 0.8
    )  # so that the mean is good to 0.1; the regularizing prior alone would give 0.40


@pytest.mark.parametrize(("knots", "step"), [(4, 1.5), (6, 1.5 * np.sqrt(3 / 5)), (8, 1.5 * np.sqrt(3 / 7))])
def test_the_sizes_of_paths_drawn_from_the_regularizing_prior_are_as_dense_as_said(knots, step, rng):
    # T of splines through knots whose steps are normal, read at 400 times; its density at ln 1
    count = knots - 1
    drawn = step * rng.standard_normal((200_000, 2, count))
    places = np.concatenate([np.zeros((200_000, 2, 1)), drawn.cumsum(axis=2)], axis=2)
    matrix = CubicSpline(np.linspace(0, 1, knots), np.eye(knots))((np.arange(400) + 0.5) / 400)
    matrix -= matrix.mean(axis=0)
    totals = np.einsum("nak,kl,nal->n", places, matrix.T @ matrix / 400, places, optimize=True)
    half = 0.1
    near = np.sum(np.abs(np.log(totals)) < half)
    density = near / len(totals) / (2 * half)
    # what the evidence divides by: its prior of so many sqrt(T) in each step, and nothing else
    steps = np.resize([0.1, 0.03, -0.05, 0.02, 0.08, 0.01], 2 * count)
    sxx, _, syy = np.asarray(Path(steps).moments())
    sigma, width = 1e-9, step * np.sqrt(sxx + syy)
    free = np.log(2) + 2 * count * np.log(sigma / width) - 0.5 * np.sum(steps**2) / width**2
    # a count's error four times: 3.2 %; the density bends by 0.2 % over so narrow a bin
    evidence = log_evidence(regularized(steps, sigma))
    assert evidence == pytest.approx(free - np.log(density), abs=4 / np.sqrt(near) + 0.002)


def test_the_evidence_of_a_path_does_not_depend_on_its_size():
    steps = np.array([0.1, 0.03, -0.05, 0.02, 0.08, 0.01])
    small, large = (log_evidence(regularized(size * steps, size * 1e-4)) for size in (1.0, 7.0))
    assert large == pytest.approx(small, abs=1e-9)


def test_half_of_a_normals_prior_is_on_a_straight_one():
    # In the larger variance, the axis's angle and the minor variance, the disc has density 4/(pi T³) (T - 0),
    # the factor being the Jacobian of eigenvalues, and the rim 1/(pi T).  A narrow posterior on the rim is
    # 2 pi sigma²/T wide in the first two (T dphi = dSxy), and half a normal of sigma in the third.
    total, sigma = 0.02, 1e-4
    along = 2 * np.pi * sigma**2 / total
    disc = along * 4 / (np.pi * total**2) * 0.5 * np.sqrt(2 * np.pi) * sigma
    rim = along / (np.pi * total)
    evidence = log_evidence(fitted("mvn", Mvn(jnp.array([total, 0.0, 0.0])), sigma))
    assert evidence == pytest.approx(np.log(0.5 * disc + 0.5 * rim), abs=1e-9)


def test_deviance_counts_by_half_and_a_wider_posterior_is_more_evidence():
    locus = Shm.of(0.4, 30.0)
    plain = log_evidence(fitted("shm", locus, 1e-4))
    assert log_evidence(fitted("shm", locus, 1e-4, 6.0)) == pytest.approx(plain - 3.0)
    assert log_evidence(fitted("shm", locus, 2e-4)) == pytest.approx(plain + 2 * np.log(2))


def test_a_variance_below_zero_leaves_what_of_the_posterior_is_above():
    sigma, total = 1e-4, 0.02
    inside, outside = (Ellipse(jnp.array([total - s, 0.0, s])) for s in (10 * sigma, -2 * sigma))
    lost = log_evidence(fitted("ellipse", inside, sigma)) - log_evidence(fitted("ellipse", outside, sigma))
    assert lost == pytest.approx(-np.log(0.022750131948), rel=1e-6)  # a normal's tail beyond 2 sigma


def test_a_part_that_cannot_be_distinguished_from_nothing_has_no_evidence():
    assert log_evidence(fitted("tones", Tones.of(0.4, 30.0, 0.01, 80.0), 1e-3)) == -np.inf
    assert log_evidence(fitted("smear", Smear.of(0.01, 30.0, 0.1), 1e-3)) == -np.inf
    assert log_evidence(fitted("smear", Smear.of(0.4, 30.0, 0.01), 1e-3)) == -np.inf
    assert np.isfinite(log_evidence(fitted("smear", Smear.of(0.4, 30.0, 0.1), 1e-4)))


def test_a_fit_that_broke_down_has_no_evidence():
    good = fitted("shm", Shm.of(0.4, 30.0), 1e-4)
    assert log_evidence(replace(good, covariance=np.full((2, 2), np.nan))) == -np.inf
    assert log_evidence(FitResult(Status.FAILED, "", locus="shm")) == -np.inf
    assert log_evidence(replace(good, locus="haunted")) == -np.inf


def test_the_minor_variance_is_the_lesser_eigenvalue():
    variance, error = minor_variance(np.array([0.03, 0.01, 0.02]), np.eye(3) * 1e-8)
    assert variance == pytest.approx(np.linalg.eigvalsh([[0.03, 0.01], [0.01, 0.02]])[0])
    # across = (s², -2sc, c²) for moments of equal, independent errors
    angle = 0.5 * np.arctan2(0.02, 0.01)
    s, c = np.sin(angle), np.cos(angle)
    assert error == pytest.approx(1e-4 * np.sqrt(s**4 + 4 * s**2 * c**2 + c**4))
