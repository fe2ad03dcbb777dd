"""The optics of an instrument on one frame's grid, ready to be asked for a transfer function."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, expand
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum

__all__ = ["FixedOptics", "OpticalSystem"]


@dataclass(frozen=True)
class OpticalSystem:
    """A pupil, a spectrum and a grid; its aberrations can be changed."""

    pupil: Pupil
    spectrum: Spectrum
    grid: Grid

    @cached_property
    def nominal(self) -> OTF:
        """Transfer function without aberrations, computed once."""
        return expand(self.pupil, self.spectrum, self.grid)

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with its derivatives unless not wanted."""
        return expand(self.pupil, self.spectrum, self.grid, aberrations, derivatives=derivatives)


@dataclass(frozen=True)
class FixedOptics:
    """A transfer function that is what it is: an empirical PSF."""

    nominal: OTF

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """The same whatever is asked for."""
        return self.nominal
