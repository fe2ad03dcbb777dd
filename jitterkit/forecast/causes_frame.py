"""Information of one frame about the causes of its width: jitter, diffusion, defocus and seeing.

Reach for :class:`Setting`, a scene before a telescope; its :meth:`Setting.frame` is the information of a
frame under a jitter.  An image is linear in its transfer function, so that whatever multiplies this by
``exp(a g(f))`` has the slope ``IFFT{spectrum g}``: :func:`with_mode` hands ``OTF g`` to the optics as one
more mode beside their aberrations, and the one forward model does the rest.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forecast.bound import forecast
from jitterkit.forecast.causes_information import Information
from jitterkit.forward import Parameters, free_parameters, image_and_jacobian
from jitterkit.loci import Locus, Stable, Streak, axis_variances, moments_on_axis
from jitterkit.loci.elliptic import Elliptic
from jitterkit.optics import Optics
from jitterkit.optics.otf import OTF
from jitterkit.precision import to_parts
from jitterkit.refit import FitOptions
from jitterkit.scene import Scene

JITTER = ("jitter_along", "jitter_turn", "jitter_across")
"""Second moments of the pointing on its own axis, arcsec²; a streak has the first two."""

SQUARE = "noll4_square"
"""Defocus where its sign does not show: the square of the coefficient, nm²."""

_FRIED, _FWHM = 3.44, 0.98
"""Of a long exposure through Kolmogorov turbulence: ``OTF = exp(-3.44 (wavelength f/r0)^(5/3))``, whose image
is ``0.98 wavelength/r0`` wide at half its maximum (Fried, J. Opt. Soc. Am. 56, 1372, 1966)."""

_STEP = 2.0
"""Nm of defocus for its second derivative: the fourth weighs 4e-5 at 585 nm, rounding 1e-12."""


def with_mode(otf: OTF, name: str, value: float, slope) -> OTF:
    """Wrap optics with one more parameter that may vary.

    Parameters
    ----------
    otf : OTF
    name : str
    value : float
        Where it stands in ``otf``.
    slope : (My, Mx//2 + 1) array
        Derivative of the transfer function by it.
    """
    rows, shifts = len(otf.slopes), len(otf.sigmas) - len(otf.of_b)
    tints = otf.tints
    if tints is not None:
        tints = jnp.concatenate([tints, jnp.zeros_like(tints[:1])])
    return replace(
        otf,
        slopes=jnp.concatenate([otf.slopes, to_parts(jnp.asarray(slope, complex))[None]]),
        state=jnp.insert(otf.state, rows, value),
        names=(*otf.names[:rows], name, *otf.names[rows:]),
        tints=tints,
        sigmas=(*otf.sigmas[:shifts], math.inf, *otf.sigmas[shifts:]),
    )


def seeing_power(fwhm: float) -> float:
    """Coordinate of the seeing, regular at zero: its FWHM [arcsec] to the power 5/3, as ``r0^(-5/3)``."""
    return fwhm ** (5 / 3)


def with_seeing(otf: OTF, fwhm: float, ratio: float = 1.0) -> OTF:
    """Wrap optics behind an atmosphere, whose :func:`seeing_power` may vary.

    Parameters
    ----------
    otf : OTF
    fwhm : float
        Of the image of a long exposure, arcsec; zero for none.
    ratio : float
        The wavelength over that at which the FWHM is given: seeing falls as its fifth root.
    """
    fy, fx = otf.grid.frequencies
    slope = -_FRIED * (np.hypot(fx, fy) / _FWHM) ** (5 / 3) * ratio ** (-1 / 3)
    blur = np.exp(seeing_power(fwhm) * slope)
    seen = otf.multiplied(blur)
    return with_mode(seen, "seeing", seeing_power(fwhm), seen.value * slope)


@dataclass(frozen=True)
class Setting:
    """A scene before a telescope, with all that widens the image but the jitter.

    Attributes
    ----------
    scene : Scene
    optics : Optics
        Without diffusion of its own; a measured PSF holds the detector's, and what is asked about is more.
    detector : Detector, optional
    exposure : float
        s, for a dark current.
    aberrations : tuple of float
        nm, in the order of the optics' names.
    diffusion : float
        Variance per axis, arcsec².
    seeing : float, optional
        FWHM of a long exposure, arcsec, at the wavelength of the settings ``ratio`` is one for.  None where
        there is no atmosphere, so that it is not a cause.
    ratio : float
        Wavelength over that at which the seeing is given.
    square : bool
        Whether defocus shows by its square; see :func:`choose_defocus`.
    hold : collection of str
        Parameters that are known.
    """

    scene: Scene
    optics: Optics
    detector: Detector | None = None
    exposure: float = field(default=0.0, kw_only=True)
    aberrations: tuple[float, ...] = ()
    diffusion: float = 0.0
    seeing: float | None = None
    ratio: float = 1.0
    square: bool = False
    hold: Collection[str] = ()

    @cached_property
    def otf(self) -> OTF:
        """The optics, with modes for the square of defocus and for the seeing where they are causes."""
        otf = self.optics.otf(np.array(self.aberrations))
        if self.square:
            otf = with_mode(otf, SQUARE, 0.0, self._curvature(otf))
        return otf if self.seeing is None else with_seeing(otf, self.seeing, self.ratio)

    def _curvature(self, otf: OTF):
        """Return half the second derivative by defocus, from the images of both signs and of none."""
        step = _STEP * np.array([name == "noll4" for name in otf.names[: len(self.aberrations)]])
        states = (np.array(self.aberrations) + sign * step for sign in (1, -1))
        up, down = (self.optics.otf(state, derivatives=False).value for state in states)
        return (up + down - 2 * otf.value) / (2 * _STEP**2)

    @property
    def shared(self) -> tuple[str, ...]:
        """Return the names of what is the same in every frame: aberrations, seeing and diffusion."""
        return (*self.otf.names, "diffusion")

    def under(self, locus: Locus) -> Parameters:
        """Return all parameters of a frame under a jitter."""
        parameters = Parameters(self.scene, locus, self.otf.state, diffusion=self.diffusion)
        return parameters.completed(self.otf)

    def frame(self, locus: Locus) -> Information:
        """Return the information of one frame under a jitter, its own moments named as :data:`JITTER`.

        Raises
        ------
        ConfigurationError
            If the jitter has no second moments to ask about.
        """
        held = FitOptions(hold=self._held)
        found = forecast(self.under(locus), self.otf, self.detector, held, exposure=self.exposure)
        new, slope = _on_axis(locus)
        information = Information(found.names, found.information)
        return information.changed(locus.names[: len(new)], new, slope)

    def slopes(self, locus: Locus) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the expected image (ny, nx) and its derivatives, by the names of :meth:`frame`."""
        parameters = self.under(locus)
        names, free = free_parameters(parameters, self.otf, self._held)
        image, jacobian = (np.asarray(a) for a in image_and_jacobian(parameters, self.otf, free))
        by_name = dict(zip(names, jacobian, strict=True))
        new, slope = _on_axis(locus)
        moments = [by_name.pop(name) for name in locus.names[: len(new)]]
        if moments:
            by_name |= dict(zip(new, np.tensordot(np.linalg.inv(slope).T, moments, 1), strict=True))
        return image, by_name

    @property
    def _held(self) -> set[str]:
        return {*self.hold, "noll4"} if self.square else {*self.hold}


def _on_axis(locus: Locus) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the moments on the jitter's axis, and their derivatives (n, n) by its first coordinates."""
    rows = 0 if isinstance(locus, Stable) else 2 if isinstance(locus, Streak) else 3
    if rows == 3 and not isinstance(locus, Elliptic):
        problem = f"The second moments of a {type(locus).__name__.lower()} are not free"
        remedy = "ask about causes with the locus mvn, ellipse, shaped, linear, shm or stable"
        raise ConfigurationError(ErrorCode.UNSUPPORTED, f"{problem}; {remedy}.")
    moments = np.asarray(locus.moments())
    if rows == 2 and not axis_variances(moments)[0] > 0:
        problem = "A streak of length 0 has no axis; give its length, or the locus mvn."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    turn = np.array([moments_on_axis(unit, axis_variances(moments)[2]) for unit in np.eye(3)]).T
    by_coords = np.asarray(jax.jacfwd(lambda c: locus.at(c).moments())(locus.coords))[:, :rows]
    return JITTER[:rows], (turn @ by_coords)[:rows]


def choose_defocus(setting: Setting) -> Setting:
    """Let defocus about perfect focus be asked about by its square where that shows first.

    Where the optics are their own mirror image both signs look the same, and elsewhere the sign may show so
    weakly that the widening is seen before it: the square's slope, in sigmas, then exceeds that of the
    coefficient squared.
    """
    names = setting.optics.nominal.names
    if "noll4" not in names or setting.aberrations[names.index("noll4")] != 0:
        return setting
    by_square = replace(setting, square=True)
    linear, square = _information_on_defocus(setting, "noll4"), _information_on_defocus(by_square, SQUARE)
    return by_square if square**0.5 > linear else setting


def _information_on_defocus(setting: Setting, name: str) -> float:
    """Return the information about it, the scene unknown and other causes known."""
    information = setting.frame(Stable.of())
    others = [cause for cause in setting.shared if cause != name]
    return float(information.knowing(others).about((name,)).matrix[0, 0])
