"""A round core under a uniform line: what a trailed star says about its trail without a sharp one.

The moments of one image cannot tell a long core from a trail.  If the core is round, the cross
section tells its profile (Moffat's, here), and the length along the axis is the line's.

:func:`length_model_error` says what the misfit of a model to the mean star means for the length of a trail.
The mean star tells: in a single one the shape of a trail drowns in noise, and in a sum over all their pixels
in that of the sky.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares
from scipy.special import gamma, kv

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Linear, Locus, principal_axes
from jitterkit.optics import OTF
from jitterkit.optics.grid import Grid
from jitterkit.scene import Star
from jitterkit.starfield.psf import Psf

_POOR = 1.5
"""Chi-squared a pixel from which the model is not the truth: trails of 1 to 8 pixels leave 0.95 to 1.12
under a reference's stars, a vibration of 5 leaves 3.9."""

_NONSENSE, _AMISS = 100.0, 0.2
"""Chi-squared a pixel, and share of the star's amplitude, from which together a model says nothing: the
noise alone of many bright stars finds fault with any round core."""


class Misfit(NamedTuple):
    """Misfit of a model to a mean star.

    Attributes
    ----------
    chi2_dof : float
        Chi-squared a pixel.
    share : float
        Root mean square of what is left, over that of the star.
    """

    chi2_dof: float
    share: float


def misfit_under(stack: Psf, psf: Psf, otf: OTF, line: Locus) -> Misfit:
    """Return what a PSF under a line leaves of the mean star, the noise of both counted.

    Parameters
    ----------
    stack : Psf
        The trailed stars' mean; position, flux and sky of it are fitted.
    psf : Psf
        The sharp stars', in stamps of any size.
    otf : OTF
        Made of it, on the stack's grid.
    line : Locus
        In pixels.
    """
    model = np.asarray(expected_image(Parameters(Star(0.0, 0.0, 1.0), line, ()), otf))
    down, right = np.gradient(model)
    terms = np.stack([model, right, down, np.ones(model.shape)])
    fy, fx = otf.grid.frequencies
    smoothed = float(np.mean(np.square(np.asarray(line.transfer(fx, fy)))))  # of white noise, by the line
    sharp = centred(psf.error, stack.error.shape[0])
    error = np.hypot(stack.error, np.sqrt(smoothed) * sharp)
    seen = (stack.error > 0) & (sharp > 0)
    design, data = (terms[:, seen] / error[seen]).T, stack.stamp[seen] / error[seen]
    left = data - design @ np.linalg.lstsq(design, data, rcond=None)[0]
    share = np.linalg.norm(left * error[seen]) / np.linalg.norm(stack.stamp[seen])
    return Misfit(float(left @ left) / (data.size - len(terms) - len(line.coords)), float(share))


def length_model_error(
    misfit: Misfit, model: str, length: float, elongation: float
) -> tuple[float, tuple[str, ...]]:
    """Return the error that a poor fit adds to a length, and a remark.

    Parameters
    ----------
    misfit : Misfit
    model : str
        What was fitted, in words.
    length : float
        By the fit [pixels].
    elongation : float
        Difference of the adaptive variances along and across [pixels²]: the length by moments.

    Raises
    ------
    UndeterminedError
        If the fit is so poor that it says nothing.
    """
    if misfit.chi2_dof > _NONSENSE and misfit.share > _AMISS:
        problem = f"{model} leaves chi²/dof {misfit.chi2_dof:.3g} and {misfit.share:.0%} of the mean star"
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{problem}; its shape is not a trail's.")
    if misfit.chi2_dof < _POOR:
        return 0.0, ()
    model_error = abs(np.sqrt(12 * max(elongation, 0.0)) - length) / 2
    return float(model_error), (
        f"{model} leaves chi²/dof {misfit.chi2_dof:.1f}; half the difference to the length by moments is in "
        "the error.",
    )


def centred(stamp: np.ndarray, side: int) -> np.ndarray:
    """Return a stamp cut to another odd side, or filled up with zeros."""
    half, wanted = stamp.shape[0] // 2, side // 2
    cut = max(half - wanted, 0)
    return np.pad(stamp[cut : stamp.shape[0] - cut, cut : stamp.shape[1] - cut], max(wanted - half, 0))


_PAD = 16
_BETA = (1.2, 30.0)
"""Moffat's exponents that are tried: the lower spreads without end, the upper is a normal."""


class RoundCore(NamedTuple):
    """A Moffat star drawn along a line.

    Attributes
    ----------
    line : Linear
        In pixels.
    fwhm, beta : float
        Of the core, before the pixel [pixels].
    misfit : Misfit
        Of the fit to the mean star, noise alone.
    """

    line: Linear
    fwhm: float
    beta: float
    misfit: Misfit


def moffat_transfer(f: np.ndarray, fwhm: float, beta: float) -> np.ndarray:
    """Transfer function of Moffat's profile ``(1 + r²/a²)^-beta`` at frequencies f, in 1/unit of the FWHM.

    ``2 u^(b-1) K_(b-1)(2u) / Gamma(b-1)`` with ``u = pi a f``: Hankel's transform of a power
    (Gradshteyn & Ryzhik 6.565.4).

    >>> moffat_transfer(np.array([0.0]), 3.0, 2.5)
    array([1.])
    """
    u = np.maximum(np.pi * f * fwhm / (2 * np.sqrt(2 ** (1 / beta) - 1)), 1e-9)
    order = beta - 1
    with np.errstate(under="ignore"):
        return 2 * u**order * kv(order, 2 * u) / gamma(order)


def fit_round_core(psf: Psf, moments: np.ndarray) -> RoundCore:
    """Fit a round core drawn along a line to a mean star.

    Parameters
    ----------
    psf : Psf
        The trailed stars' own mean.
    moments : (3,) array
        Their adaptive moments [pixels²]: where the fit starts.

    Returns
    -------
    core : RoundCore

    Notes
    -----
    *Assumes* a round core of Moffat's profile, and a line.  On Moffat stars of FWHM 3 pixels drawn
    over 4, the length comes out to 0.2 %; moments, taken for variances, say 13 % more.  *Fails when*
    the core is not round: then it is the length of the line that would make it so.
    """
    grid = Grid(psf.stamp.shape, 1.0, _PAD)
    fy, fx = grid.frequencies
    radius = np.hypot(fx, fy)
    cy, cx = grid.centre
    pixel = np.sinc(fx) * np.sinc(fy)
    seen = psf.error > 0  # what no star shows was filled from nothing

    def image(p):
        flux, sky, x, y, log_fwhm, log_beta, *coords = p
        cosine, sine = coords  # in NumPy's 64 bits: differences of 32 would not move the line
        square = np.hypot(cosine, sine) * radius**2 + cosine * (fx**2 - fy**2) + 2 * sine * fx * fy
        line = np.sinc(np.sqrt(np.maximum(square, 0) / 2))
        spectrum = flux * moffat_transfer(radius, np.exp(log_fwhm), np.exp(log_beta)) * pixel * line
        shift = np.exp(-2j * np.pi * (fx * (x + cx) + fy * (y + cy)))
        return grid.crop(np.fft.irfft2(spectrum * shift, s=grid.fine_shape)) + sky

    major, minor, angle = principal_axes(moments)
    length = np.sqrt(12 * max(major**2 - minor**2, 1e-3))
    coords = np.asarray(Linear.of(length, angle).coords)
    start = [1.0, 0.0, 0.0, 0.0, np.log(2.2 * minor), np.log(3.5), *coords]
    lower, upper = np.full(8, -np.inf), np.full(8, np.inf)
    lower[4:6], upper[4:6] = np.log([0.3, _BETA[0]]), np.log([100.0, _BETA[1]])

    def residual(p):
        return (image(p) - psf.stamp)[seen] / psf.error[seen]

    fit = least_squares(residual, start, bounds=(lower, upper), x_scale="jac")
    line = Linear(jnp.asarray(fit.x[6:]))
    dof = int(seen.sum()) - len(start)
    share = np.linalg.norm(fit.fun * psf.error[seen]) / np.linalg.norm(psf.stamp[seen])
    misfit = Misfit(2 * fit.cost / dof, float(share))
    return RoundCore(line, float(np.exp(fit.x[4])), float(np.exp(fit.x[5])), misfit)
