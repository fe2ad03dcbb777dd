"""Every choice that trades speed for accuracy, by name.

Reach for :func:`preset`; :meth:`Settings.applied` makes what fits with them.  A setting changes the
instrument that is modelled, or the options of its fit; the formulae stay the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ConfigurationError, ErrorCode, one_of, positive
from jitterkit.instruments import Instrument
from jitterkit.optics import DEFAULT_PAD, OpticalSystem
from jitterkit.refit import FitOptions

ABERRATIONS = ("held", "anchored", "expanded")
"""At what they are without any; fitted about one state of many frames; computed again for every frame."""

JITTER = ("seen", "always")
"""Fitted, where the locus is ``auto``, to frames that show some; or to every frame."""

METHODS = ("score", "mtf", "refit", "joint", "sampling")
"""How the separation is had: see :mod:`jitterkit.trade.methods`."""


@dataclass(frozen=True)
class Settings:
    """Exactness with which a frame is modelled and fitted.

    Attributes
    ----------
    pad : int or None
        Pixels of padding on each side of the frame: light that leaves it on one side must not come back.
        None for the instrument's own.
    samples : int or None
        Wavelengths; None for the instrument's own.
    binning : int
        Samples of the pupil, along each axis, that become one.
    aberrations : str
        One of :data:`ABERRATIONS`.
    without : tuple of str
        Aberrations that are held at zero, whatever the others are.
    tolerance : float
        Step, in standard errors, below which a fit has arrived.
    region : int or None
        Pixels along each side that are cut out about the stars; None for the instrument's own frame.
    bits : int
        64 or 32.
    nodes : int or None
        Of the integral over time in loci that have no formula; None for as many as they have themselves.
    jitter : str
        One of :data:`JITTER`.
    method : str
        One of :data:`METHODS`, for the grid; a :class:`~jitterkit.batch.FrameProcessor` refits whatever it
        is.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    pad: int | None = None
    samples: int | None = None
    binning: int = 1
    aberrations: str = "anchored"
    without: tuple[str, ...] = ()
    tolerance: float = 1e-4
    region: int | None = None
    bits: int = 64
    nodes: int | None = None
    jitter: str = "always"
    method: str = "refit"

    def __post_init__(self) -> None:
        known = {"aberrations": ABERRATIONS, "jitter": JITTER, "method": METHODS, "bits": (32, 64)}
        for name, choices in known.items():
            if (value := getattr(self, name)) not in choices:
                listed = ", ".join(map(str, choices))
                code = ErrorCode.OUT_OF_RANGE if name == "bits" else ErrorCode.UNKNOWN_NAME
                raise ConfigurationError(code, f"{name} = {value!r} is unknown; choose one of {listed}.")
        positive("tolerance", self.tolerance, "parts of an error")
        for name, least in (("pad", 0), ("samples", 1), ("binning", 1), ("region", 1), ("nodes", 3)):
            value = getattr(self, name)
            if value is not None and value < least:
                problem = f"{name} = {value} is impossible; give at least {least}."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)

    def instrument(self, instrument: Instrument) -> Instrument:
        """Return the instrument as it is modelled.

        Raises
        ------
        ConfigurationError
            If its pupil cannot be binned so.
        """
        ny, nx = instrument.shape
        side = self.region or max(ny, nx)
        changes: dict[str, Any] = {"shape": (min(ny, side), min(nx, side))}
        if self.pad is not None:
            changes["pad"] = self.pad
        if instrument.spectrum is not None and self.samples is not None:
            changes["spectrum"] = instrument.spectrum.sampled(self.samples)
        if instrument.pupil is not None:  # made once for all settings
            pupil = instrument.pupil
            changes["pupil_from"] = pupil.binned(self.binning) if self.binning > 1 else pupil
        return replace(instrument, **changes)

    def at_least(self, instrument: Instrument) -> Settings:
        """Return settings with at least the padding and the wavelengths of an instrument."""
        pad = None if self.pad is None else max(self.pad, own_pad(instrument))
        own = 0 if instrument.spectrum is None else len(instrument.spectrum.wavelengths)
        return replace(self, pad=pad, samples=None if self.samples is None else max(self.samples, own))

    def options(self, instrument: Instrument, options: FitOptions | None = None) -> FitOptions:
        """Return the options of a fit: others, with what is held and when it has arrived."""
        options = FitOptions() if options is None else options
        held = instrument.aberrations if self.aberrations == "held" else self.without
        nodes = options.nodes if self.nodes is None else self.nodes
        hold, still = (*options.hold, *held), self.jitter == "seen"
        return replace(options, hold=hold, tolerance=self.tolerance, nodes=nodes, may_be_still=still)

    def applied(self, processor: FrameProcessor) -> FrameProcessor:
        """Return a copy of another processor with these settings.

        In as many bits as JAX is set to, and with aberrations anchored where the state is known.
        """
        telescope = processor.instrument
        options = self.options(telescope, processor.options)
        return replace(processor, instrument=self.instrument(telescope), options=options, known={})


PRESETS = {
    "fast": Settings(pad=16, tolerance=1e-2),
    "balanced": Settings(),
    "exact": Settings(pad=128, samples=16, tolerance=1e-6),
}
"""Points of the measured front (``jitterkit docs results/trade``), which :func:`preset` adapts to others."""


def preset(name: str, instrument: Instrument) -> Settings:
    """Return the settings of a preset for an instrument.

    Parameters
    ----------
    name : str
        One of :data:`PRESETS`.
    instrument : Instrument

    Returns
    -------
    settings : Settings
        ``exact`` never models less than the instrument itself asks for, and ``fast`` never pads more.

    Raises
    ------
    ConfigurationError
        If there is none of that name.
    """
    settings, pad = PRESETS[one_of("preset", name, PRESETS)], own_pad(instrument)
    if name == "fast" and settings.pad is not None:
        return replace(settings, pad=min(settings.pad, pad))
    return settings.at_least(instrument) if name == "exact" else settings


def own_pad(instrument: Instrument) -> int:
    """Return the pixels of padding that an instrument is modelled with where no setting says otherwise."""
    if instrument.pad is not None:
        return instrument.pad
    system = instrument.system()
    return system.grid.pad if isinstance(system, OpticalSystem) else DEFAULT_PAD


def own_values(instrument: Instrument) -> dict[str, int]:
    """Return what an instrument says itself of settings that may be None; 0 wavelengths of a measured PSF."""
    samples = 0 if instrument.spectrum is None else len(instrument.spectrum.wavelengths)
    return {"pad": own_pad(instrument), "samples": samples, "region": max(instrument.shape)}
