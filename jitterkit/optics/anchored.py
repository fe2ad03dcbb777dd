"""Optics of a frame that is one of many: by an anchor where that is exact, computed anew where it is not."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from jitterkit.optics.anchor import Anchor, SecondOrder
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import OpticalSystem

THIRD_ORDER = 1.5
"""What the second order leaves out of an image, as a share of it, by the cube of the phase's rms [rad]: 0.5
to 1.2 for every mode of TOLIMAN's pupil and for mixtures of them."""

_UNSEEN = 0.05
"""Sigmas of the whole image that may be left out: half of what a fit's own linearisation may."""

_SLOPES = 0.1
"""Rms phase [rad] up to which the derivatives are taken from the anchor, where the value no longer can be:
they are off by up to 2 % there."""

_BENT = 0.3
"""Rms phase [rad] up to which second derivatives do for a step that is checked by exact optics."""

_WORTH = 8
"""Expansions of states near each other from which an anchor saves time.  Making one takes as long as 5 (18
hexagons, 9 modes) or 9 (TOLIMAN, 20 modes)."""

_ANCHORS, _REMEMBERED = 2, 64
"""Anchors that are kept, of a star and of a pair; and states that were expanded."""


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
        return _left_out(self.photons, self._distance(aberrations))

    def _distance(self, aberrations) -> float:
        """Return the rms phase [rad] from the anchor."""
        modes = len(self.anchor.state)
        state, beside = self.anchor.further.split(np.asarray(aberrations), modes)
        return self.system.phase_of(state - np.asarray(self.anchor.state), beside)

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Expand the optics near a state, as :class:`Optics` has it; derivatives cost nothing here."""
        return self.otf(aberrations)

    def second_order(self, aberrations) -> SecondOrder:
        """Return the second derivatives, which hardly depend on the state."""
        return self.anchor.second


def _left_out(photons: float, phase: float) -> float:
    """Return what the second order leaves out of an image at a distance [rad rms], in sigmas of the whole."""
    return float(THIRD_ORDER * np.sqrt(photons) * phase**3)


@dataclass(frozen=True)
class SelfAnchoringOptics:
    """The optics of one frame, whose fits ask again and again for states close to each other.

    They are expanded, until so many lie near one that an anchor about it saves time.

    Parameters
    ----------
    system : OpticalSystem
    photons : float
        Of the frame: how small a change it shows.
    """

    system: OpticalSystem
    photons: float
    _anchored: deque[AnchoredOptics] = field(default_factory=lambda: deque(maxlen=_ANCHORS), init=False)
    _expanded: deque[np.ndarray] = field(default_factory=lambda: deque(maxlen=_REMEMBERED), init=False)

    @property
    def nominal(self) -> OTF:
        """Return the transfer function to start from."""
        return self.system.nominal

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm] over the lit pupil, at the shortest wavelength."""
        return self.system.phase(aberrations)

    def __reduce__(self) -> tuple:
        """Leave the anchors to this process."""
        return type(self), (self.system, self.photons)

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Return the transfer function about ``aberrations`` [nm]: as good as exact, with its derivatives."""
        anchored = self._beside(aberrations, anew=derivatives)
        return (anchored or self.system).otf(aberrations, derivatives=derivatives)

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Expand the optics near a state, as :class:`Optics` has it."""
        anchored = self._beside(aberrations, anew=False)
        return self.system.near(aberrations, slopes) if anchored is None else anchored.otf(aberrations)

    def second_order(self, aberrations) -> SecondOrder:
        """Return second derivatives about ``aberrations`` [nm], or near them."""
        modes = np.array(aberrations, float)[: len(self.system.pupil.names)]
        for anchored in self._anchored:
            if self.system.phase(modes - np.asarray(anchored.anchor.state)) < _BENT:
                return anchored.anchor.second
        return self._anchored_at(modes).anchor.second

    def _beside(self, aberrations, *, anew: bool) -> AnchoredOptics | None:
        """Return optics by an anchor that reaches a state, perhaps a new one; None where there is none."""
        if self.system.of_b:
            return None  # an anchor is about one wavefront, of both stars
        for place, anchored in enumerate(self._anchored):
            if anchored.reaches(aberrations):
                del self._anchored[place]
                self._anchored.appendleft(anchored)
                return anchored
        if not anew:
            return None
        state = np.array(aberrations, float)
        apart = [self.system.phase(state - other) for other in self._expanded if len(other) == len(state)]
        if sum(_left_out(self.photons, phase) < _UNSEEN for phase in apart) < _WORTH:
            self._expanded.extend([state] * (0.0 not in apart))
            return None
        self._expanded.clear()  # so that anchors are made for new ones only
        return self._anchored_at(state)

    def _anchored_at(self, state: np.ndarray) -> AnchoredOptics:
        anchored = AnchoredOptics.about(self.system, Anchor.at(self.system, state), self.photons)
        self._anchored.appendleft(anchored)
        return anchored
