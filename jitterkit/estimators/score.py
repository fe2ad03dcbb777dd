"""The blur from Fisher-scoring steps in all parameters, started from no jitter at all.

At zero jitter the signed moments ``(Sxx, Sxy, Syy)`` are regular parameters, so one step from there,
with everything else free beside them, is an efficient estimate of a small blur (Le Cam's one-step
estimator); up to four steps remove what the first leaves at larger ones.  One step more, from the normal
that fits, tests its shape.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.estimators.compressed import ORDERS, shaped_blur
from jitterkit.estimators.shape import (
    DECISIVE,
    KURTOSIS,
    CumulantStep,
    ShapedBlur,
    fit_shape,
    inflate_covariance,
)
from jitterkit.forward import Parameters, free_parameters
from jitterkit.kernel_estimate import KernelEstimate, is_detected
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn, Shaped
from jitterkit.optics import Optics
from jitterkit.optics.otf import OTF
from jitterkit.scoring import fisher_scoring_without_prior
from jitterkit.squares import free_squares


def estimate_score(
    data: Data,
    template: Parameters,
    otf: OTF,
    *,
    steps: int = 4,
    hold: Collection[str] = (),
    shape: float | None = None,
    optics: Optics | None = None,
) -> KernelEstimate:
    """Estimate second moments by Fisher scoring from zero jitter, and test the shape of the blur.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations to start from; its locus is ignored.
    otf : OTF
        About the template's aberrations.
    steps : int
        Scoring steps for a normal, rejected ones included.
    hold : collection of str
        Parameters to keep at the template's values.
    shape : float, optional
        Excess kurtosis, where the kind of motion is known: -1.2 of a drift, -1.5 of a vibration, 0 of
        random motion.  By default it is measured.
    optics : Optics, optional
        Of the template: then squares of aberrations may have either sign, where they show by these only,
        as :func:`~jitterkit.squares.free_squares` says.

    Returns
    -------
    estimate : KernelEstimate
        Its scatter is at the Cramér-Rao bound of what was fitted.  With a shape given, its ``locus`` has that
        shape.  Otherwise ``shape`` is NaN where no blur is detected.  While it says little (an error above
        1.2: of a drift below 0.36 arcsec on TOLIMAN at 1e7 photons), the moments are those of the normal with
        the closest image, and their errors hold what the shape might do to them; beyond, those of a blur
        whose shape is fitted with them, which then is its ``locus``.

    Raises
    ------
    UndeterminedError
        If the information is singular: the frame does not determine the parameters.  Or if no blur of the
        shape given fits.
    ConfigurationError
        If no density has the shape given.

    Notes
    -----
    *Fails when* the blur is wider than the optics' resolution and not of this family of shapes: lopsided, or
    two tones.
    """
    start = template.with_locus(Mvn.near(jnp.zeros(3)))
    (normal, *_), covariance = fisher_scoring_without_prior(start, otf, data, hold, steps)
    if not np.all(np.isfinite(covariance)):
        problem = "The frame does not determine its parameters; hold some, or mask less of it."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    if shape is not None:
        return _of_known_shape(normal, shape, otf, data, hold, optics)
    return estimate_from_normal(normal, otf, data, hold, optics)[0]


def estimate_from_normal(
    normal: Parameters, otf: OTF, data: Data, hold: Collection[str], optics: Optics | None = None
) -> tuple[KernelEstimate, Parameters]:
    """Estimate second moments, and test the shape of the blur, from the fit of a normal.

    Parameters
    ----------
    normal : Parameters
    otf : OTF
        Expanded near there.
    data : Data
    hold : collection of str
        What the fit held.
    optics : Optics, optional
        As for :func:`estimate_score`.

    Returns
    -------
    estimate : KernelEstimate
        As :func:`estimate_score` gives it.
    parameters : Parameters
        All that was fitted with its blur.
    """
    names = free_parameters(normal, otf, hold)[0]
    step = CumulantStep.of(normal, names, otf, data, ORDERS)
    moments, covariance = _with_free_squares(normal, names, step.covariance(), data, optics, hold)
    if not is_detected(moments, covariance):
        return KernelEstimate(moments, covariance, "score"), normal
    found, blur = step.shape(), None
    if found.error < DECISIVE:
        blur = shaped_blur(step, otf, data, hold)
    if blur is None:
        covariance = inflate_covariance(
            covariance, np.array([found.response[name] for name in Shaped.names[:3]])
        )
        shape, error = found.kurtosis, found.error
        return KernelEstimate(moments, covariance, "score", shape=shape, shape_err=error), normal
    return _of_shaped(blur, otf, data, hold, optics), blur.parameters


def _of_shaped(
    blur: ShapedBlur, otf: OTF, data: Data, hold: Collection[str], optics: Optics | None
) -> KernelEstimate:
    """Return the estimate of a blur that was fitted with its shape."""
    names, shape = free_parameters(blur.parameters, otf, hold)[0], blur.kurtosis
    moments, covariance = _with_free_squares(
        blur.parameters, names, blur.covariance[:3, :3], data, optics, hold
    )
    locus, error = Shaped(np.append(moments, shape)), blur.kurtosis_err
    return KernelEstimate(moments, covariance, "score", shape=shape, shape_err=error, locus=locus)


def _with_free_squares(
    fitted: Parameters,
    names: tuple[str, ...],
    covariance: np.ndarray,
    data: Data,
    optics: Optics | None,
    hold: Collection[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the moments of a fitted blur and their covariance, with free squares where these matter."""
    moments = np.asarray(fitted.locus.moments())
    free = None if optics is None else free_squares(fitted, names, data, optics, hold)
    if free is None:
        return moments, covariance
    index = [free.places.tolist().index(names.index(name)) for name in fitted.locus.names[:3]]
    return moments + free.change[index], free.covariance[np.ix_(index, index)]


def _of_known_shape(
    normal: Parameters,
    shape: float,
    otf: OTF,
    data: Data,
    hold: Collection[str],
    optics: Optics | None,
) -> KernelEstimate:
    kurtosis = float(Shaped.of(0.0, kurtosis=shape).coords[3])  # refuses what no density has
    hold = {*hold, KURTOSIS}
    blur = fit_shape(normal, kurtosis, otf, data, hold)
    if blur is None:
        problem = f"No blur of excess kurtosis {shape:g} fits the frame; give another, or let it be measured."
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, problem)
    return replace(_of_shaped(blur, otf, data, hold, optics), shape=math.nan, shape_err=math.nan)
