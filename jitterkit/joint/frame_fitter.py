"""Fit one frame with the shared parameters held.

Its own parameters (position, flux, jitter) are fitted while the shared ones are held; then the normal
equations of all are computed once, and its own parameters are eliminated.  The fit is the refit of a single
frame with the shared parameters held, nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import GRADIENT, Parameters, free_parameters, held_with, parameter_names, to_vector
from jitterkit.frames import Frame
from jitterkit.joint.likelihood_summary import LikelihoodSummary, eliminate
from jitterkit.known_light import KnownLight
from jitterkit.likelihood import Data, normal_equations
from jitterkit.locate import ModelError, allow_for_model, check_model_error, locate_binary
from jitterkit.loci import Mvn, Streak, axis_variances, locus_class
from jitterkit.optics.colours import Colours
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions, FitResult, Priors, SceneChoice, Status, choose_scene
from jitterkit.refit.evidence import CHOICES
from jitterkit.refit.fit import fit_and_allow
from jitterkit.refit.locus_fit import starting_point
from jitterkit.refit.outliers import Fitted, fit_without_outliers
from jitterkit.refit.scene_choice import found_allowing
from jitterkit.scene import Binary, Stars
from jitterkit.shutter import Shutter

_STRAIGHT = ("stable", "path", *(name for name, choice in CHOICES.items() if choice.across == "none"))
"""Loci that are lines: they have no blur across their axis."""


_SQUARE = 2.0
"""Errors by which the square of an aberration must differ from zero to be varied: to vary noise costs little,
and a focus that is held makes moments of a frame wrong by about as many errors."""

_SHINING = 5.0
"""Errors of its flux from which a pair rises above the noise, as its second star has to."""

_VISIBLE = 0.015
"""Rms [arcsec] of a streak that a fit starts from where the frame shows none."""


@dataclass(frozen=True)
class FrameFitter:
    """Fit the frames of a sequence one by one.

    Attributes
    ----------
    optics : Optics
    locus : str
        A name in ``LOCI``.
    known : tuple of str
        Parameters that are neither shared nor a frame's own.
    priors : Priors
        On a frame's own parameters.
    diffusion : bool
        Whether the frames share a charge diffusion, beyond what the optics hold, that is to be measured.
    censored : bool
        Whether full pixels count; see :meth:`jitterkit.likelihood.Data.of`.
    scene : str
        ``"auto"`` to refuse frames that show no pair, or ``"binary"``.
    model_error : float or "auto"
        Of :class:`~jitterkit.refit.FitOptions`.
    known_light : KnownLight or None
        What to take out of the frames.
    shown : tuple of str
        Aberrations that frames show though a symmetric pupil hides them about zero (:meth:`seeing`).

    Raises
    ------
    ConfigurationError
        If diffusion is asked for with a locus that blurs all ways itself.
    """

    optics: Optics
    locus: str = "mvn"
    known: tuple[str, ...] = ()
    priors: Priors = field(default_factory=Priors)
    diffusion: bool = False
    censored: bool = False
    scene: str = "auto"
    model_error: ModelError = 0.0
    known_light: KnownLight | None = None
    shown: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        locus_class(self.locus)
        check_model_error(self.model_error)
        if self.scene not in ("auto", Binary.name):
            problem = f"A sequence is of a pair: scene {self.scene!r} is none of auto, {Binary.name}"
            remedy = "'jitterkit process' fits the others"
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; {remedy}.")
        if self.diffusion and self.locus not in _STRAIGHT and self.priors.moments is None:
            raise ConfigurationError(
                ErrorCode.NOT_CONSTRAINED,
                f"Jitter of the kind {self.locus!r} blurs all ways, as diffusion does, and no number of "
                f"frames separates them. Take one of {', '.join(_STRAIGHT)}, or a prior on the jitter.",
            )

    @cached_property
    def hold(self) -> tuple[str, ...]:
        """Return the parameters that no fit varies: those known, and aberrations without effect."""
        return (*self.known, *self.hidden)

    @cached_property
    def hidden(self) -> tuple[str, ...]:
        """Return the aberrations that are not known, and that a symmetric pupil hides."""
        unseen = self.optics.nominal.blind()
        return tuple(name for name in unseen if name not in (*self.known, *self.shown))

    @property
    def flags(self) -> tuple[str, ...]:
        """Return what a pupil that is its own mirror image means for all frames."""
        return (*["aberrations_held"] * bool(self.hidden), *["sign_unknown"] * bool(self.shown))

    def seeing(self, frames: Iterable[Frame]) -> FrameFitter:
        """Return the fitter that varies hidden aberrations if the first frame that can be fitted shows one.

        It shows by its square alone; of what noise makes of it, nothing is to be shared.  Beside one that
        is real all others show in proportion, by their products with it.
        """
        if not self.hidden:
            return self
        trial = replace(self, shown=self.hidden)
        alone = partial(trial._fit_alone, shutter=None)
        fits = (self.without_outliers(frame, alone)[1].result for frame in frames)
        fit = next((fit for fit in fits if fit.status.usable and fit.parameters is not None), None)
        if fit is None or fit.parameters is None:
            return self
        values = dict(zip(self.optics.nominal.names, np.asarray(fit.parameters.aberrations), strict=False))
        # half the relative error of a square is that of the value
        is_shown = any(abs(values[name]) > 2 * _SQUARE * fit.error(name) for name in self.hidden)
        return trial if is_shown else self

    @cached_property
    def shared(self) -> tuple[str, ...]:
        """Return the names of the shared parameters, in the order of the parameter vector."""
        nominal = self.optics.nominal
        known = nominal.colours
        coloured = known is not None and nominal.tints is not None and known.sigma > 0
        colours = Binary.colours if coloured else ()
        every = ("separation", "theta", "contrast", *colours, *nominal.names)
        return tuple(name for name in (*every, *["diffusion"] * self.diffusion) if name not in self.hold)

    @cached_property
    def own(self) -> tuple[str, ...]:
        """Return the names of each frame's own parameters."""
        every = ("x", "y", "flux", *locus_class(self.locus).names, "background", *GRADIENT)
        held = held_with(self.hold)
        return tuple(name for name in every if name not in held)

    def without_outliers(
        self, frame: Frame, fit: Callable[[Frame], tuple[FitResult, OTF]], known: np.ndarray | None = None
    ) -> tuple[Frame, Fitted]:
        """Fit a frame without outlier pixels, of which some may be known (ny, nx); return it with its fit."""
        light, error = self.known_light, self.model_error
        return fit_without_outliers(
            frame, lambda one: Fitted(*fit(one)), known=known, known_light=light, model_error=error
        )

    def fit_first(
        self, frame: Frame, shutter: Shutter | None, near: Mapping[str, float] | None = None
    ) -> tuple[FitResult, OTF]:
        """Fit a frame of which nothing is known: find the pair, fit everything, then its own again.

        ``near`` are the shared parameters of other frames: star A is theirs, and theta within half a turn.
        """
        fit, otf = self._fit_alone(frame, shutter, is_pair=near is not None)
        if fit.parameters is None or not fit.status.usable:
            return fit, otf
        values = _alike(self.values_of(fit.parameters), near)
        if near is not None and sum(values[name] * near[name] for name in self.shown) < 0:
            values |= {name: -values[name] for name in self.shown}  # no image shows their signs
        start = self.at(fit.parameters, values)
        return self.refit(frame, start, self.optics.otf(np.asarray(start.aberrations)) if self.shown else otf)

    def _fit_alone(
        self, frame: Frame, shutter: Shutter | None, *, is_pair: bool = False
    ) -> tuple[FitResult, OTF]:
        """Find the pair of a frame, and fit everything."""
        data = self._data(frame)
        nominal = self.optics.nominal
        if not np.any(np.asarray(data.used)):
            return FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}."), nominal
        search = self._choice if self.scene == "auto" and not is_pair else self._pair
        choice, data = found_allowing(search, data, nominal, self.model_error, rough=False)
        if choice is None:
            return FitResult(Status.NO_STAR, f"{Status.NO_STAR.value}: there is no star to fit."), nominal
        if search == self._choice and choice.scene != Binary.name:
            problem = f"{Status.NO_PAIR.value}: 'jitterkit process' measures its jitter."
            if choice.scene == Stars.name:
                problem = "it shows a field of stars; --scene binary fits the brightest two as a pair."
            return FitResult(Status.NO_PAIR, problem), nominal
        start, p = choice.start, choice.start.parameters
        begin = replace(p, shutter=shutter)
        options = FitOptions(hold=self.hold, priors=self.priors, model_error=self.model_error)
        fit, otf, _ = fit_and_allow(data, self.optics, begin, start.otf, options)
        if self.diffusion and fit.parameters is not None:
            fit = replace(fit, parameters=self._split_diffusion(fit.parameters))
        return self._with_locus(data, fit, otf, options)

    def refit(self, frame: Frame, start: Parameters, otf: OTF) -> tuple[FitResult, OTF]:
        """Fit a frame's own parameters from a start near them, with the locus."""
        return self._check_plausible(
            *fit_and_allow(self._data(frame), self.optics, start, otf, self._options)[:2]
        )

    def fit_cold(self, frame: Frame, start: Parameters, image, otf: OTF) -> tuple[FitResult, OTF]:
        """Fit a frame's own parameters from another frame's, its jitter unknown.

        Parameters
        ----------
        frame : Frame
        start : Parameters
            Of the other frame.
        image : (ny, nx) array
            The expected image of that other frame: its best match gives the position of the pair.
        otf : OTF
        """
        data = self._data(frame)
        pitch = self.optics.nominal.grid.plate_scale
        dy, dx = (pitch * shift for shift in _shift(np.asarray(data.electrons), np.asarray(image)))
        start = start.with_locus(Mvn(jnp.zeros(3)))
        start = self.at(start, {"x": float(start.scene.x) + dx, "y": float(start.scene.y) + dy})
        normal, near, _ = fit_and_allow(data, self.optics, start, otf, self._options)
        return self._check_plausible(*self._with_locus(data, normal, near, self._options))

    def likelihood_summary(
        self, frame: Frame, fit: FitResult, otf: OTF, time: float, *, first: bool = False
    ) -> LikelihoodSummary | None:
        """Return a frame's likelihood summary of the shared parameters; None where it was not fitted.

        The first of a sequence includes the priors of colours and shifts, which count once.
        """
        if fit.parameters is None or not fit.status.usable or not np.all(np.isfinite(fit.covariance)):
            return None
        names, free = free_parameters(fit.parameters, otf, self.hold)
        shared = [names.index(name) for name in self.shared]
        own = [names.index(name) for name in fit.names]
        where = fit.parameters, fit.image, otf, self.model_error
        data = allow_for_model(self._data(frame), *where).clear(fit.image)
        if not first:
            colours = None if otf.colours is None else Colours(sigma=math.inf)
            otf = replace(otf, colours=colours, sigmas=(math.inf,) * len(otf.sigmas))
        equations = normal_equations(fit.parameters, otf, data, free, exact=False)
        score, information = np.array(equations.score), equations.information
        score[own] = 0.0  # its own are at the maximum of their posterior, priors included
        at = np.array(list(self.values_of(fit.parameters).values()))
        return LikelihoodSummary(time, at, *eliminate(score, information, shared, own, fit.covariance))

    def at(self, parameters: Parameters, values: Mapping[str, float]) -> Parameters:
        """Return parameters with some replaced, by name; further stars keep their positions in the sky."""
        scene = parameters.scene
        dx, dy = (
            values.get(name, float(getattr(scene, name))) - float(getattr(scene, name)) for name in "xy"
        )
        light = values.get("flux", float(scene.flux)) / float(scene.flux)
        parameters = eqx.tree_at(lambda p: p.scene, parameters, scene.shifted(dx, dy).brightened(light))
        if self.diffusion and parameters.diffusion is None:
            parameters = replace(parameters, diffusion=jnp.zeros(()))
        vector, unravel = to_vector(parameters)
        names = parameter_names(parameters, self.optics.nominal.names)
        numbers = np.array(vector)
        for name, value in values.items():
            numbers[names.index(name)] = value
        return unravel(jnp.asarray(numbers))

    def values_of(self, parameters: Parameters) -> dict[str, float]:
        """Return the shared parameters by name."""
        vector, _ = to_vector(parameters)
        names = parameter_names(parameters, self.optics.nominal.names)
        known = {"diffusion": 0.0, **dict(zip(names, np.asarray(vector), strict=True))}
        return {name: float(known[name]) for name in self.shared}

    def _split_diffusion(self, parameters: Parameters) -> Parameters:
        """Return parameters whose normal blur is split: the part across its axis becomes diffusion."""
        _, minor, _ = axis_variances(parameters.locus.moments())
        rest = Mvn(parameters.locus.coords - minor * jnp.array([1.0, 0.0, 1.0]))
        return self.at(parameters.with_locus(rest), {"diffusion": minor})

    @cached_property
    def _options(self) -> FitOptions:
        hold = (*self.hold, *self.shared)
        return FitOptions(hold=hold, priors=self.priors, model_error=self.model_error)

    def _choice(self, data: Data, *, rough: bool) -> SceneChoice | None:
        """Choose the scene of data."""
        return choose_scene(data, self.optics, FitOptions(hold=self.hold), rough=rough)

    def _pair(self, data: Data, *, rough: bool) -> SceneChoice | None:
        """Search data for a pair."""
        start = locate_binary(data, self.optics, self.hold, rough=rough)
        return None if start is None else SceneChoice(start, math.inf)

    def _data(self, frame: Frame) -> Data:
        return Data.of(frame, censored=self.censored)

    def _check_plausible(self, fit: FitResult, otf: OTF) -> tuple[FitResult, OTF]:
        """Return the fit; with another status if it shows no star, or is implausible."""
        if (p := fit.parameters) is None:
            return fit, otf
        grid = self.optics.nominal.grid
        if "flux" in fit.names and fit.of_scene("flux") < _SHINING * fit.error("flux"):
            return replace(fit, status=Status.NO_STAR, message=f"{Status.NO_STAR.value}."), otf
        if problem := p.implausible(grid.shape, grid.plate_scale):
            return replace(fit, status=Status.POOR_FIT, message=f"{Status.POOR_FIT.value}: {problem}."), otf
        return fit, otf

    def _with_locus(self, data: Data, normal: FitResult, otf: OTF, options) -> tuple[FitResult, OTF]:
        """Fit the locus, starting from the fit of a normal."""
        if self.locus == "mvn" or normal.parameters is None or not np.all(np.isfinite(normal.covariance)):
            return normal, otf
        kind, moments = locus_class(self.locus), normal.moments()[0]
        start = starting_point(kind, moments, normal.parameters, otf, data, options)
        fit, near, _ = fit_and_allow(data, self.optics, start, otf, options)
        if fit.status is not Status.NOT_CONVERGED or not issubclass(kind, Streak):
            return fit, near
        # a streak that noise has made too short to start from
        longer = start.with_locus(kind.near(jnp.array([_VISIBLE**2, 0.0, 0.0])))
        return fit_and_allow(data, self.optics, longer, otf, options)[:2]


def _alike(values: dict[str, float], near: Mapping[str, float] | None) -> dict[str, float]:
    """Return the values of a pair with its stars named, and its direction counted, as in another frame."""
    if near is None or not {"theta", "contrast"} <= values.keys():
        return values
    theta, contrast = values["theta"], values["contrast"]
    if math.cos(math.radians(theta - near["theta"])) < 0:  # the stars are about as bright as each other
        theta, contrast = theta + 180, 1 / contrast
        swapped = [values[name] for name in reversed(Binary.colours) if name in values]
        values = values | dict(zip(Binary.colours, swapped, strict=False))
    turns = round((near["theta"] - theta) / 360)
    return {**values, "theta": theta + 360 * turns, "contrast": contrast}


def _shift(image: np.ndarray, template: np.ndarray) -> tuple[int, int]:
    """Return the whole pixels, down rows and along columns, by which an image matches a template best."""
    product = np.fft.rfft2(image) * np.conj(np.fft.rfft2(template))
    peak = np.unravel_index(np.argmax(np.fft.irfft2(product, s=image.shape)), image.shape)
    dy, dx = ((int(k) + n // 2) % n - n // 2 for k, n in zip(peak, image.shape, strict=True))
    return dy, dx
