"""Forecast the effect of settings on the separation of a frame, without a fit.

Reach for :meth:`Example.of` with a frame of a run, then for :meth:`Example.forecast`.  Where the image of a
model is off by ``d``, its fit is off by ``F⁻¹ J'W d``: one scoring step from the truth.  Image, slopes and
information are those of the model with the settings, for it is their score that the fit brings to zero.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jitterkit.batch import FrameProcessor
from jitterkit.batch.warm_start import SCORE
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.frames import Frame, RawFrame
from jitterkit.likelihood import Data, NormalEquations, normal_equations
from jitterkit.loci import Mvn
from jitterkit.metric import invert_information
from jitterkit.refit import FitResult
from jitterkit.refit.choose import DETECTED, is_jitter_undetected
from jitterkit.trade.scenes import truest
from jitterkit.trade.settings import Settings

_CREDIBLE = 2.0
"""Standard errors by which a parameter that is left out may differ from its fitted value."""

UNSEEN = (math.sqrt(DETECTED) + _CREDIBLE) ** 2
"""Chi-squared of the largest jitter of a frame that shows none: more is missed in less than one frame of
fifty."""


class BiasForecast(NamedTuple):
    """Hold the expected bias and error of the separation of a fit with some settings.

    Attributes
    ----------
    bias : float
        Of the separation, to first order, signed [arcsec].
    sigma : float
        Standard error of the separation, by the model with these settings [arcsec].
    misfit : float
        Their contribution to chi-squared, in units of its own scatter.
    scatter : float
        Of chi-squared.
    """

    bias: float
    sigma: float
    misfit: float
    scatter: float


@dataclass(frozen=True, eq=False)
class Example:
    """Hold a fitted frame of a run, whose fit is taken for the truth.

    Attributes
    ----------
    raw : RawFrame
    frame : Frame
        Calibrated, cut to what the instrument fits.
    result : FitResult
    processor : FrameProcessor
        That fitted it.
    """

    raw: RawFrame
    frame: Frame
    result: FitResult
    processor: FrameProcessor
    _known_information: dict[Settings, tuple[tuple[str, ...], np.ndarray]] = field(
        init=False, repr=False, default_factory=dict
    )

    @classmethod
    def of(cls, raw: RawFrame, processor: FrameProcessor) -> Example | None:
        """Fit a frame; None of one that cannot be fitted."""
        processed = processor.process(raw)
        if processed.frame is None or not processed.result.status.usable:
            return None
        return cls(raw, processed.frame, processed.result, processor)

    @property
    def truth(self) -> Parameters:
        """Return the fit, with colours and wavelength as expected: the assumed truth of the frame."""
        assert self.result.parameters is not None  # what is usable has them
        parameters, instrument = self.result.parameters, self.processor.instrument
        modes = parameters.aberrations[: len(instrument.aberrations)]
        parameters = eqx.tree_at(lambda p: p.aberrations, parameters, modes)
        if parameters.scene.indices is None or instrument.colours is None:
            return parameters
        coloured = parameters.scene.coloured(instrument.colours.of(len(parameters.scene.indices)))
        return eqx.tree_at(lambda p: p.scene, parameters, coloured)

    @property
    def still(self) -> bool:
        """Return whether a frame may be fitted without jitter: it shows none, and its kind was not given.

        Only of the score estimate, by which a frame's jitter is seen or not, are the errors those of the fit.
        """
        processor, locus = self.processor, self.truth.locus
        given = processor.prior is not None or processor.priors.on_jitter()
        if given or processor.locus != "auto" or processor.kernel != SCORE:
            return False
        fitted = isinstance(locus, Mvn) and set(locus.names) <= set(self.result.names)
        return fitted and is_jitter_undetected(*self.result.moments())

    @cached_property
    def _at_rest(self) -> Example:
        """Return the example with the jitter that noise has caused set to zero."""
        truth = self.truth.with_locus(Mvn.near(jnp.zeros(3)))
        return replace(self, result=replace(self.result, parameters=truth))

    @cached_property
    def image(self) -> np.ndarray:
        """Return the expected electrons (ny, nx), exact."""
        optics = truest(self.processor.instrument, self.frame.shape, self._scale)
        otf = optics.otf(self.truth.aberrations, derivatives=False)
        return np.asarray(expected_image(self.truth, otf), float)

    @property
    def _scale(self) -> float:
        return self.frame.plate_scale or self.processor.instrument.plate_scale

    def forecast(self, settings: Settings) -> BiasForecast:
        """Forecast bias and error of the separation of a fit with some settings.

        Raises
        ------
        ConfigurationError
            If the instrument cannot be modelled so, or the frame does not determine its parameters then.
        FrameError
            If so small a region shows nothing.

        Notes
        -----
        *Assumes* an error small against the resolution of the parameters, and a fit that
        converges.  Of priors it counts those on single parameters.
        """
        names, equations, known, pixels = self._equations(settings.applied(self.processor))
        covariance, sound = invert_information(equations.information + known)
        if not sound:
            problem = f"{self.raw.name} does not determine its parameters with {settings}."
            raise ConfigurationError(ErrorCode.NOT_CONSTRAINED, problem)
        index = names.index("separation")
        step = covariance @ equations.score
        scatter = math.sqrt(2 * pixels)
        misfit = (equations.deviance - equations.score @ step) / scatter
        return BiasForecast(float(step[index]), math.sqrt(covariance[index, index]), float(misfit), scatter)

    def without(self, names: Collection[str], settings: Settings | None = None) -> float:
        """Return the possible change of the separation if fitted aberrations are held at zero [arcsec].

        Parameters
        ----------
        names : collection of str
            Of aberrations.
        settings : Settings, optional
            That the rest is fitted with.

        Returns
        -------
        change : float
            What their values change, to first order, and two of the errors that is known to by all of the
            frame.
        """
        whole, information = self._information(Settings())
        held = [name in names for name in whole]
        if not any(held):
            return 0.0
        gone = np.flatnonzero(held)
        values = np.array([self._value(whole[i]) for i in gone])
        covariance, _ = invert_information(information)
        free, information = self._information(replace(settings or Settings(), without=()))
        gone_here = np.array([free.index(whole[i]) for i in gone])
        slope = _change(information, free.index("separation"), gone_here)
        error = math.sqrt(slope @ covariance[np.ix_(gone, gone)] @ slope)
        return float(abs(slope @ values) + _CREDIBLE * error)

    def without_jitter(self, settings: Settings) -> float:
        """Return the possible change of the separation by undetected jitter that is not fitted [arcsec].

        Parameters
        ----------
        settings : Settings
            That the rest is fitted with.

        Returns
        -------
        change : float
            Of moments two errors beyond the edge of what is said to be none, in whatever direction moves the
            separation most.
        """
        names, information = self._at_rest._information(replace(settings, jitter="always"))
        moments = np.array([names.index(name) for name in self.truth.locus.names])
        slope = _change(information, names.index("separation"), moments)
        covariance, _ = invert_information(information)
        spread = math.sqrt(slope @ covariance[np.ix_(moments, moments)] @ slope)
        return math.sqrt(UNSEEN) * spread

    def _information(self, settings: Settings) -> tuple[tuple[str, ...], np.ndarray]:
        """Return the names of the free parameters, and their information by image and priors."""
        if settings not in self._known_information:
            names, equations, known, _ = self._equations(settings.applied(self.processor))
            self._known_information[settings] = names, np.asarray(equations.information + known)
        return self._known_information[settings]

    def _value(self, name: str) -> float:
        """Return the value of an aberration, or of a coordinate of the locus."""
        names = (*self.processor.instrument.aberrations, *self.truth.locus.names)
        return float([*self.truth.aberrations, *self.truth.locus.coords][names.index(name)])

    def _equations(self, processor: FrameProcessor) -> tuple[tuple[str, ...], NormalEquations, Array, int]:
        """Return names of free parameters, normal equations of the exact image, prior precision, pixels."""
        frame = processor.calibrate(self.raw)
        held = processor.options.hold
        truth, nodes = self._seen_in(frame, held), processor.options.nodes
        truth = truth if nodes is None else truth.with_locus(truth.locus.sampled(nodes))
        optics = processor.instrument.system(shape=frame.shape, plate_scale=self._scale)
        otf = optics.otf(truth.aberrations)
        truth = truth.completed(otf)
        names, free = free_parameters(truth, otf, held)
        (x0, y0), (ny, nx) = np.array(frame.origin) - self.frame.origin, frame.shape
        exact = self.image[y0 : y0 + ny, x0 : x0 + nx]
        data = Data.of(replace(frame, electrons=exact), censored=processor.censored).clear(exact)
        known = jnp.asarray(processor.priors.over(names, truth.locus).precision)
        return names, normal_equations(truth, otf, data, free), known, int(data.used.sum())

    def _seen_in(self, frame: Frame, held: Collection[str]) -> Parameters:
        """Return the truth, in the coordinates of a part of the frame, with held aberrations at zero."""
        middle, whole = (np.array(one.origin) + np.array(one.shape[::-1]) / 2 for one in (frame, self.frame))
        x, y = (whole - middle) * self._scale
        free = np.array([name not in held for name in self.processor.instrument.aberrations], bool)
        aberrations = jnp.where(free, self.truth.aberrations, 0.0)
        return eqx.tree_at(lambda p: p.aberrations, self.truth.shifted(x, y), aberrations)


def _change(information: np.ndarray, index: int, held: np.ndarray) -> np.ndarray:
    """Return the change of a parameter with those that are held, the others being fitted again."""
    kept = np.delete(np.arange(len(information)), held)
    narrow, _ = invert_information(information[np.ix_(kept, kept)])
    return narrow[kept.tolist().index(index)] @ information[np.ix_(kept, held)]
