"""Optics of a frame that is one of many: by an anchor where that is exact, computed anew where it is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.optics.anchor import Anchor
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import OpticalSystem

_THIRD_ORDER = 1.5
"""What the second order leaves out of an image, as a share of it, by the cube of the phase's rms [rad]: 0.5
to 1.2 for every mode of TOLIMAN's pupil and for mixtures of them."""

_UNSEEN = 0.05
"""Sigmas of the whole image that may be left out: half of what a fit's own linearisation may."""

_SLOPES = 0.1
"""Rms phase [rad] up to which the derivatives are taken from the anchor, where the value no longer can be:
they are off by up to 2 % there."""


@dataclass(frozen=True)
class AnchoredOptics:
    """The optics of a frame that is one of many, near one state of the aberrations.

    Parameters
    ----------
    system : OpticalSystem
        Asked for what lies too far from the anchor.
    anchor : Anchor
    photons : float
        Of a frame: how small a change it shows.
    nominal : OTF
        Transfer function to start from.
    coarse : Anchor, optional
        The anchor on the grid of its second derivatives, which has less padding, in 32 bits: derivatives of
        images are computed there.
    """

    system: OpticalSystem
    anchor: Anchor
    photons: float
    nominal: OTF
    coarse: Anchor | None = None

    @classmethod
    def about(cls, system: OpticalSystem, anchor: Anchor, photons: float, start=None) -> AnchoredOptics:
        """To start from some aberrations [nm]; by default those of the anchor."""
        return cls(system, anchor, photons, anchor.otf(anchor.state if start is None else start))

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm] over the lit pupil, at the shortest wavelength."""
        return self.system.phase(aberrations)

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Return the transfer function about ``aberrations`` [nm]: as good as exact, with its derivatives."""
        if self._distance(aberrations) > _SLOPES:
            return self.system.otf(aberrations, derivatives=derivatives)
        here = self.anchor.otf(aberrations, self.coarse)
        return here if self.reaches(aberrations) else self.system.near(aberrations, here)

    def reaches(self, aberrations) -> bool:
        """Return whether the anchor alone is as good as exact at ``aberrations`` [nm]."""
        return self.left_out(aberrations) < _UNSEEN

    def left_out(self, aberrations) -> float:
        """Return an upper bound on the anchor's error in the image, in sigmas of the whole."""
        return float(_THIRD_ORDER * np.sqrt(self.photons) * self._distance(aberrations) ** 3)

    def _distance(self, aberrations) -> float:
        """Return the rms phase [rad] from the anchor."""
        modes = len(self.anchor.state)
        state, beside = self.anchor.further.split(np.asarray(aberrations), modes)
        return self.system.phase_of(state - np.asarray(self.anchor.state), beside)

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Expand the optics near a state, as :class:`Optics` has it; derivatives cost nothing here."""
        return self.otf(aberrations)
