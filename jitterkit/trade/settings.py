"""Every choice that trades speed for accuracy, by name.

Reach for :data:`PRESETS`; :meth:`Settings.finder` makes what finds and fits with them.  Nothing else in the
package chooses between fast and exact: a setting changes the instrument that is modelled, or the options of
its fit, and the formulae stay the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from jitterkit.batch import Processor
from jitterkit.errors import ConfigurationError
from jitterkit.instruments import Instrument
from jitterkit.refit import FitOptions

__all__ = ["ABERRATIONS", "PRESETS", "Settings", "settings_of"]

ABERRATIONS = ("held", "anchored", "expanded")
"""At what they are without any; fitted about one state of many frames; computed anew for every frame."""


@dataclass(frozen=True)
class Settings:
    """How exactly a frame is modelled and fitted.

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
    tolerance : float
        Step, in standard errors, below which a fit has arrived.
    region : int or None
        Pixels along each side that are cut out about the stars; None for the instrument's own frame.
    bits : int
        64 or 32.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    pad: int | None = None
    samples: int | None = None
    binning: int = 1
    aberrations: str = "anchored"
    tolerance: float = 1e-4
    region: int | None = None
    bits: int = 64

    def __post_init__(self) -> None:
        if self.aberrations not in ABERRATIONS:
            known = ", ".join(ABERRATIONS)
            raise ConfigurationError(f"aberrations = {self.aberrations!r} is unknown; choose one of {known}.")
        if self.bits not in (32, 64):
            raise ConfigurationError(f"bits = {self.bits} is unknown; choose 32 or 64.")
        if not self.tolerance > 0:
            raise ConfigurationError(
                f"tolerance = {self.tolerance} is not positive; give a part of an error."
            )
        for name in ("pad", "samples", "binning", "region"):
            value = getattr(self, name)
            if value is not None and value < (0 if name == "pad" else 1):
                raise ConfigurationError(f"{name} = {value} is impossible; give a number of pixels.")

    def instrument(self, instrument: Instrument) -> Instrument:
        """The instrument as it is modelled.

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
        if instrument.pupil is not None and self.binning > 1:
            changes["pupil_from"] = instrument.pupil.binned(self.binning)
        return replace(instrument, **changes)

    def options(self, instrument: Instrument, options: FitOptions | None = None) -> FitOptions:
        """The options of a fit: others, with what is held and when it has arrived."""
        options = FitOptions() if options is None else options
        held = instrument.aberrations if self.aberrations == "held" else ()
        return replace(options, hold=(*options.hold, *held), tolerance=self.tolerance)

    def processor(
        self, instrument: Instrument, locus: str = "mvn", options: FitOptions | None = None
    ) -> Processor:
        """What fits frames of an instrument with these settings."""
        return Processor(self.instrument(instrument), locus=locus, options=self.options(instrument, options))


PRESETS = {
    "fast": Settings(pad=16, tolerance=1e-2),
    "balanced": Settings(),
    "exact": Settings(pad=128, samples=16, tolerance=1e-6),
}
"""Points of the measured front: see the README."""


def settings_of(preset: str) -> Settings:
    """The settings of a preset.

    Raises
    ------
    ConfigurationError
        If there is none of that name.
    """
    if preset not in PRESETS:
        raise ConfigurationError(f"There is no preset {preset!r}; choose one of {', '.join(PRESETS)}.")
    return PRESETS[preset]
