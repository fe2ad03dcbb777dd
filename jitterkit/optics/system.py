"""The optics of an instrument on one frame's grid, ready to be asked for a transfer function."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jitterkit.optics.colours import Colours
from jitterkit.optics.expansion import expand
from jitterkit.optics.further import Further
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum

_EVEN = 0.1
"""Effect of a mode about no aberrations on the transfer function, as a share of it for each rad rms, below
which its square may be all that shows: 0.01 to 0.03 of focus and astigmatism behind symmetric pupils with a
spider, 0.3 and more of other modes and behind other pupils."""


_KEPT = {True: 2, False: 16}
"""Expansions with and without derivatives that a thread keeps: one of the end of a fit and another; and those
about the twelve changes of its modes by which products are measured."""


class _Latest(threading.local):
    """Hold the latest expansions of a thread, which fits one frame at a time; a copy begins empty."""

    def __init__(self) -> None:
        self.expansions: dict[bool, OrderedDict] = {True: OrderedDict(), False: OrderedDict()}

    def __reduce__(self):
        return type(self), ()


class Optics(Protocol):
    """Define what a fit needs of a telescope's optics on one grid."""

    @property
    def system(self) -> Optics:
        """Return the optics that none of the expansions kept for a frame replaces."""
        ...

    @property
    def nominal(self) -> OTF:
        """Return the transfer function to start from."""
        ...

    def phase(self, aberrations) -> float:
        """Return the rms phase [rad] of a wavefront error [nm]."""
        ...

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Return the transfer function about ``aberrations`` [nm]."""
        ...

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with the derivatives of an expansion nearby."""
        ...


@dataclass(frozen=True)
class OpticalSystem:
    """A pupil, a spectrum and a grid, and the detector's charge diffusion; its aberrations can be changed.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    grid : Grid
    diffusion : float
        How far charge wanders before it is collected: 1 sigma along each axis, arcsec.
    colours : Colours, optional
        What is known of the spectra of the stars; without, every source has the spectrum given.
    plate_scale_sigma : float
        Relative standard deviation of the plate scale, where it may vary; infinite where nothing is known.
    of_b : tuple of str
        Modes in which the wavefronts of B and A may differ.
    """

    pupil: Pupil
    spectrum: Spectrum
    grid: Grid
    diffusion: float = 0.0
    colours: Colours | None = None
    plate_scale_sigma: float = 0.0
    of_b: tuple[str, ...] = ()
    _latest: _Latest = field(default_factory=_Latest, init=False, repr=False, compare=False)

    @property
    def system(self) -> OpticalSystem:
        """Return the system itself."""
        return self

    @property
    def further(self) -> Further:
        """Return the parameters that may vary beside the modes of the pupil."""
        wavelength = 0.0 if self.colours is None else self.colours.wavelength_err * self.spectrum.mean
        return Further(len(self.pupil.shading), wavelength, self.plate_scale_sigma, self.of_b)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all that may vary of it."""
        return (*self.pupil.names, *self.further.names)

    @cached_property
    def nominal(self) -> OTF:
        """Return the transfer function without aberrations, computed once."""
        return self.otf(None)

    @cached_property
    def mode_phases(self) -> np.ndarray:
        """Rms phase (k,) of each mode of the pupil, rad/nm, at the shortest wavelength."""
        return np.sqrt(np.diag(self._gram))

    @cached_property
    def even_modes(self) -> list[int]:
        """Places of the modes that hardly change the image about no aberrations, unless by their squares."""
        return np.flatnonzero(self.mode_effects < _EVEN).tolist()

    @cached_property
    def mode_effects(self) -> np.ndarray:
        """Return the share (k,) of the transfer function by which a radian rms of each mode changes it."""
        size = self.mode_phases
        slopes = np.asarray(self.nominal.slopes[: len(size)])
        change = np.sqrt(np.sum(slopes**2, axis=(1, 2, 3))) / np.linalg.norm(self.nominal.value)
        return np.divide(change, size, out=np.full(len(size), np.inf), where=size > 0)

    @cached_property
    def _gram(self) -> np.ndarray:
        """Return mean products (k, k) of the modes over the lit pupil: phases, and relative light."""
        light, wavenumber = np.asarray(self.pupil.transmission), 2 * np.pi / min(self.spectrum.wavelengths)
        parts = wavenumber * np.asarray(self.pupil.basis), 2 * np.asarray(self.pupil.shading)
        blocks = [np.einsum("iyx,jyx,yx->ij", part, part, light, optimize=True) for part in parts]
        return scipy.linalg.block_diag(*blocks) / light.sum()

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm] over the lit pupil, at the shortest wavelength.

        Modes of the transmission count by the share of the light that they change.  Where the wavefronts of
        two stars differ, the larger of the two.
        """
        return self.phase_of(*self.further.split(np.asarray(aberrations), len(self.pupil.names)))

    def phase_of(self, change: np.ndarray, beside: np.ndarray) -> float:
        """Return the rms phase [rad] of changes of the pupil's modes, and of B's difference in some."""
        modes = self.pupil.names
        of_b = change.copy()
        of_b[[modes.index(name) for name in self.of_b]] += beside
        return float(np.sqrt(max(one @ self._gram @ one for one in (change, of_b))))

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with its derivatives unless not wanted.

        A thread keeps the latest: fits of a frame, and what is measured at their ends, ask for some again.
        """
        state = None if aberrations is None else np.asarray(aberrations, float)
        key = jnp.result_type(float), None if state is None else (state.shape, state.tobytes())
        kept = self._latest.expansions[derivatives]
        if key in kept:
            kept.move_to_end(key)
            return kept[key]
        otf = expand(
            self.pupil,
            self.spectrum,
            self.grid,
            aberrations,
            derivatives=derivatives,
            colours=self.colours,
            further=self.further,
        )
        otf = otf.diffused(self.diffusion) if self.diffusion else otf
        if not isinstance(otf.value, jax.core.Tracer):  # which would mean nothing outside its program
            kept[key] = otf
        if len(kept) > _KEPT[derivatives]:
            kept.popitem(last=False)
        return otf

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with the derivatives of an expansion nearby.

        Without derivatives it is a tenth of the work; those of a state off by a phase of rms ``q`` are off by
        about ``q`` of themselves.
        """
        exact, tints = self.otf(aberrations, derivatives=False), slopes.tints
        if tints is not None and exact.tints is not None:
            tints = tints.at[0].set(exact.tints[0])
        state = np.array(aberrations, float)
        state[len(self.pupil.names) : slopes.rows] = 0.0  # the shifts
        return replace(
            slopes,
            value=exact.value,
            state=jnp.asarray(state),
            tints=tints,
            difference=exact.difference,
        )


@dataclass(frozen=True)
class FixedOptics:
    """A transfer function that is what it is: an empirical PSF, which holds the detector's diffusion too."""

    nominal: OTF

    @property
    def system(self) -> FixedOptics:
        """Return the optics themselves."""
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all that may vary of it."""
        return self.nominal.names

    def phase(self, aberrations) -> float:
        """Return zero: there are no aberrations to change."""
        return 0.0

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Return the transfer function, which does not depend on the arguments."""
        return self.nominal

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Return the transfer function, which does not depend on the aberrations."""
        return self.nominal
