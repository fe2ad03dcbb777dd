"""An instrument: everything about a telescope that is the same from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, positive
from jitterkit.frames.metadata import QUANTITIES
from jitterkit.instruments.sky import Sky
from jitterkit.optics.colours import Colours
from jitterkit.optics.spectrum import Spectrum

if TYPE_CHECKING:
    from jitterkit.optics.otf import OTF
    from jitterkit.optics.pupil import Pupil
    from jitterkit.optics.system import FixedOptics, OpticalSystem


@dataclass(frozen=True, eq=False)
class Instrument:
    """A telescope with its light and its detector.

    Parameters
    ----------
    name : str
    plate_scale : float
        arcsec/pixel.
    shape : (int, int)
        ``(ny, nx)`` of a simulated frame, and of the region fitted in a larger one.
    detector : Detector
    spectrum : Spectrum, optional
        Of the detected photons of a source that is flat in photons per wavelength; a PSF needs none.
    pupil_from : Pupil or callable, optional
        The pupil, or a function without arguments that makes it when it is first asked for.
    psf_from : (ny, nx) array or callable, optional
        A star image in the pupil's place, likewise.
    psf_options : mapping, optional
        What else is known of it: ``oversample``, ``centre`` and ``enclosed`` of
        :func:`jitterkit.optics.empirical_otf`.
    exposure : float, optional
        s, of a usual frame.
    flux : float, optional
        Photons detected from the scene in a usual frame, inside the frame or not.
    pad : int, optional
        Pixels of padding of the model on each side; if omitted, those of
        :func:`~jitterkit.optics.grid_for`.
    plate_scale_err : float, optional
        Relative standard error of the plate scale: a prior where it is fitted.
    plate_scale_free : bool
        Whether the plate scale is fitted, which may enlarge the separation's error; not if its error is zero.
    transmission : tuple of str
        Modes of the pupil's transmission that are fitted, ``"x"``, ``"y"`` or ``"r"``: see
        :meth:`jitterkit.optics.Pupil.with_shading`.
    modes_of_b : tuple of str
        Aberrations in which the wavefronts of B and A may differ.
    aberration_sigma : float, optional
        nm, how well each aberration is known beforehand, 1 sigma about none: fits of single frames have it as
        a prior.  What it pulls is the same in every frame, and does not average out.
    colours : Colours, optional
        What is known of the spectra of the stars before the instrument; by default, that they are stars.
        None if every source has the spectrum above.
    sky : Sky, optional
        What moves a separation on the sky: corrections, which no fit uses.
    sources : mapping, optional
        Where a number comes from, by its name; begin with a word of
        :data:`jitterkit.frames.metadata.PRECEDENCE`.

    Raises
    ------
    ConfigurationError
        If a value is impossible, or there is not exactly one of pupil and PSF, or a pupil without
        a spectrum, or a PSF with charge diffusion beside it.
    """

    name: str
    plate_scale: float
    shape: tuple[int, int]
    detector: Detector = field(default_factory=Detector)
    spectrum: Spectrum | None = None
    pupil_from: Pupil | Callable[[], Pupil] | None = None
    psf_from: np.ndarray | Callable[[], np.ndarray] | None = None
    psf_options: Mapping[str, Any] = field(default_factory=dict)
    exposure: float | None = None
    flux: float | None = None
    pad: int | None = None
    plate_scale_err: float | None = None
    plate_scale_free: bool = False
    transmission: tuple[str, ...] = ()
    modes_of_b: tuple[str, ...] = ()
    aberration_sigma: float | None = None
    colours: Colours | None = field(default_factory=Colours)
    sky: Sky | None = None
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", tuple(int(n) for n in self.shape))
        if len(self.shape) != 2 or min(self.shape) < 1:
            message = f"shape = {list(self.shape)} is impossible; give [rows, columns]."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, message)
        for name in ("plate_scale", "plate_scale_err", "exposure"):
            value = getattr(self, name)
            problem = None if value is None else QUANTITIES[name].problem(value)
            if problem is not None:
                message = f"{name} = {value!r} {problem}; give it in {QUANTITIES[name].unit}."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)
        for name, unit in (("flux", "photons per frame"), ("aberration_sigma", "nm")):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), unit)
        if (self.pupil_from is None) == (self.psf_from is None):
            code = ErrorCode.MISSING_VALUE if self.pupil_from is None else ErrorCode.CONFLICT
            problem = f"The instrument {self.name!r} needs either a pupil or a PSF; give one of the two."
            raise ConfigurationError(code, problem)
        if self.psf_from is not None and self.detector.diffusion:
            raise ConfigurationError(
                ErrorCode.CONFLICT,
                f"diffusion = {self.detector.diffusion:g} in [detector] stands beside a PSF, which is taken "
                f"to hold the detector's diffusion; leave it out of the instrument {self.name!r}.",
            )
        for name in ("plate_scale_free", "transmission", "modes_of_b"):
            if getattr(self, name) and self.pupil_from is None:
                message = (
                    f"{name} asks for a pupil, and the instrument {self.name!r} has a PSF; leave it out."
                )
                raise ConfigurationError(ErrorCode.CONFLICT, message)
        if self.pupil_from is not None and self.spectrum is None:
            message = f"The instrument {self.name!r} has a pupil but no spectrum; give its band."
            raise ConfigurationError(ErrorCode.MISSING_VALUE, message)

    def source(self, name: str) -> str:
        """Return where a number comes from; ``"argument Instrument"`` where nothing else was said."""
        return self.sources.get(name, "argument Instrument")

    @cached_property
    def pupil(self) -> Pupil | None:
        """Return the pupil, made on first use; None where a PSF stands for it."""
        pupil = self.pupil_from() if callable(self.pupil_from) else self.pupil_from
        return pupil.with_shading(self.transmission) if pupil is not None and self.transmission else pupil

    @cached_property
    def psf(self) -> np.ndarray | None:
        """Return the star image ``(ny, nx)`` that stands for a pupil, read on first use; else None."""
        return self.psf_from() if callable(self.psf_from) else self.psf_from

    @property
    def aberrations(self) -> tuple[str, ...]:
        """Return the names of the aberrations of the wavefront that may vary, such as ``noll4``."""
        return () if self.pupil is None else self.pupil.names[: len(self.pupil.basis)]

    def system(
        self,
        *,
        shape: tuple[int, int] | None = None,
        plate_scale: float | None = None,
        pad: int | None = None,
    ) -> OpticalSystem | FixedOptics:
        """Return the optics on a frame's grid, and the diffusion of charge in the detector.

        Parameters
        ----------
        shape : (int, int), optional
            Of the frame, where it is not the instrument's own.
        plate_scale : float, optional
            arcsec/pixel, where a frame knows better.
        pad : int, optional
            Of padding on each side, where it is not the instrument's own.

        Returns
        -------
        system : OpticalSystem or FixedOptics
            Ask it for a transfer function at any aberrations.

        Raises
        ------
        ConfigurationError
            If the grid does not suit the pupil.
        """
        # these load JAX, which a table of metadata does not need
        from jitterkit.optics import empirical, expansion, grid, system

        pad = self.pad if pad is None else pad
        shape, scale = shape or self.shape, plate_scale or self.plate_scale
        if self.pupil is None or self.spectrum is None:
            psf = np.asarray(self.psf)
            pad = grid.DEFAULT_PAD if pad is None else pad
            return system.FixedOptics(empirical.empirical_otf(psf, scale, shape, pad=pad, **self.psf_options))
        samples = expansion.grid_for(self.pupil, self.spectrum, shape, scale, pad)
        diffusion = (self.detector.diffusion or 0.0) * scale
        colours = self.colours if self.spectrum.has_colour else None
        spectrum = self.spectrum if colours is None else colours.seen(self.spectrum)
        unknown = [name for name in self.modes_of_b if name not in self.aberrations]
        if unknown:
            there = ", ".join(self.aberrations)
            problem = f"modes_of_b names {unknown[0]!r}, which is no aberration of the instrument"
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem} {self.name!r}; there are {there}.")
        stated = math.inf if self.plate_scale_err is None else self.plate_scale_err
        known = stated if self.plate_scale_free else 0.0
        return system.OpticalSystem(
            self.pupil, spectrum, samples, diffusion, colours, known, tuple(self.modes_of_b)
        )

    def optics(self, aberrations=None, *, pad: int | None = None, derivatives: bool = True) -> OTF:
        """Return the transfer function on the instrument's own frame, as :meth:`system` has it.

        Parameters
        ----------
        aberrations : (k,) array, optional
            nm; none if omitted.
        pad : int, optional
            As in :meth:`system`.
        derivatives : bool
            Whether to compute those with respect to the aberrations.

        Returns
        -------
        otf : OTF
            Exact at ``aberrations``.

        Raises
        ------
        ConfigurationError
            If the grid does not suit the pupil, or a PSF is given aberrations.
        """
        system = self.system(pad=pad)
        if not self.aberrations and aberrations is not None and np.size(aberrations):
            problem = f"The instrument {self.name!r} has no aberrations that vary; leave them out."
            raise ConfigurationError(ErrorCode.CONFLICT, problem)
        return system.otf(aberrations, derivatives=derivatives)
