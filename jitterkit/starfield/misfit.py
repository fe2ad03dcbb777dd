"""How far the mean star is from its model, and what that says about the length of a trail.

Reach for :func:`doubt_of`.  The mean star tells: in a single one the shape of a trail drowns in noise, and in
a sum over all their pixels in that of the sky.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Locus
from jitterkit.optics import OTF
from jitterkit.scene import Star
from jitterkit.starfield.psf import Psf

_POOR = 1.5
"""Chi-squared a pixel from which the model is not the truth: trails of 1 to 8 pixels leave 0.95 to 1.12
under a reference's stars, a vibration of 5 leaves 3.9."""

_NONSENSE, _AMISS = 100.0, 0.2
"""Chi-squared a pixel, and share of the star's amplitude, from which together a model says nothing: the
noise alone of many bright stars finds fault with any round core."""


class Misfit(NamedTuple):
    """What a model leaves of a mean star.

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
    """What a PSF under a line leaves of the mean star, the noise of both counted.

    Parameters
    ----------
    stack : Psf
        The trailed stars' mean; place, flux and sky of it are fitted.
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
    sharp = _centred(psf.error, stack.error.shape[0])
    error = np.hypot(stack.error, np.sqrt(smoothed) * sharp)
    seen = (stack.error > 0) & (sharp > 0)
    design, data = (terms[:, seen] / error[seen]).T, stack.stamp[seen] / error[seen]
    left = data - design @ np.linalg.lstsq(design, data, rcond=None)[0]
    share = np.linalg.norm(left * error[seen]) / np.linalg.norm(stack.stamp[seen])
    return Misfit(float(left @ left) / (data.size - len(terms) - len(line.coords)), float(share))


def doubt_of(misfit: Misfit, model: str, length: float, elongation: float) -> tuple[float, tuple[str, ...]]:
    """Error that a poor fit adds to a length, and a remark.

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
        raise UndeterminedError(
            ErrorCode.MODEL_MISMATCH,
            f"{model} leaves chi²/dof {misfit.chi2_dof:.3g} and {misfit.share:.0%} of the mean star; its "
            "shape is not a trail's.",
        )
    if misfit.chi2_dof < _POOR:
        return 0.0, ()
    doubt = abs(np.sqrt(12 * max(elongation, 0.0)) - length) / 2
    return float(doubt), (
        f"{model} leaves chi²/dof {misfit.chi2_dof:.1f}; half the difference to the length by moments is in "
        "the error.",
    )


def _centred(stamp: np.ndarray, side: int) -> np.ndarray:
    """A stamp cut to another odd side, or filled up with zeros."""
    half, wanted = stamp.shape[0] // 2, side // 2
    cut = max(half - wanted, 0)
    return np.pad(stamp[cut : stamp.shape[0] - cut, cut : stamp.shape[1] - cut], max(wanted - half, 0))
