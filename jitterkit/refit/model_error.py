"""Errors of the model in a fit: whether to fit again because of them, and what they add to its covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jitterkit.forward import background_of
from jitterkit.likelihood import Data, slope_products
from jitterkit.locate import relative_error
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

_SAME = 0.1
"""Share by which a variance of model errors may change and be the same."""


def differs(allowed: Data, data: Data) -> bool:
    """Return whether two data allow for model errors that are not nearly the same."""
    new, old = (0.0 if d.alike_variance is None else d.alike_variance for d in (allowed, data))
    return bool(np.sum(np.abs(new - old)) > _SAME * np.sum(new))


def with_model_error(result: FitResult, data: Data, otf: OTF, free: tuple[int, ...]) -> FitResult:
    """Return a result with the model error for which its data allow, and what that adds to its covariance.

    Parameters
    ----------
    result : FitResult
    data : Data
        Of the fit, model errors among their variance.
    otf : OTF
        About the fitted aberrations.
    free : tuple of int
        Positions of what was fitted in the parameter vector.

    Notes
    -----
    A pixel of variance V, of which M is the model's, moves the fit by its slope over V.  So M adds
    ``C (sum of J' J M/V²) C`` to the covariance C.
    """
    assert data.alike_variance is not None
    assert result.parameters is not None
    error = relative_error(data, result.image, background_of(result.parameters, otf.grid))
    mean = np.asarray(result.image) + data.offset
    weight = np.zeros_like(mean)
    np.divide(data.alike_variance, mean**2, out=weight, where=data.used & (mean > 0))
    moved = np.asarray(slope_products(result.parameters, otf, weight, free))
    return replace(
        result,
        model_error=error,
        model_covariance=result.covariance @ moved @ result.covariance,
        message=f"{result.message} Errors of the model of {100 * error:.2g} % of the light were allowed for.",
        flags=(*result.flags, "model_error"),
    )
