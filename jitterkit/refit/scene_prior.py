"""What is known of a scene before its frame is looked at: one star, or a pair.

The priors are proper, since they do not cancel between scenes.  A star has a companion within an e-fold of
separation by a chance of :data:`COMPANIONS`, its difference in magnitude is uniform, its direction too.
Jitter has a size, uniform in its logarithm, or is too small to be seen, with the same chance.  Places and
fluxes have the same priors in both scenes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import log_ndtr

from jitterkit.locate import resolution
from jitterkit.optics import Colours
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult
from jitterkit.scene import Binary

COMPANIONS = 0.05
"""Share of stars that have a companion, an e-fold of separation: 44 % of stars like the sun, over a normal
law of 2.28 decades of period (Duchene & Kraus, Annu. Rev. Astron. Astrophys. 51, 269, 2013)."""

FAINTEST = 1000.0
"""Largest contrast that is searched for."""


@dataclass(frozen=True)
class ScenePrior:
    """Hold what the priors of a scene depend on.

    Parameters
    ----------
    fineness : float
        Resolution of the optics, arcsec.
    width : float
        Of the frame, arcsec, along its longer side.
    colours : Colours or None
        What is known of the stars' spectra.
    """

    fineness: float
    width: float
    colours: Colours | None

    @classmethod
    def of(cls, otf: OTF) -> ScenePrior:
        """Return the prior of scenes seen through some optics."""
        return cls(resolution(otf), otf.grid.plate_scale * max(otf.grid.shape), otf.colours)

    @property
    def log_sizes(self) -> float:
        """Return the logarithm of the range of the logarithm of the jitter's variance.

        It reaches from a hundredth of the resolution to a quarter of the frame.
        """
        return math.log(2 * math.log(25 * self.width / self.fineness))

    def log_density(self, fit: FitResult) -> float:
        """Return the logarithm of the prior density of what a scene has beside position and light."""
        assert fit.parameters is not None
        scene, known = fit.parameters.scene, self.colours
        colours = 0.0 if scene.indices is None or known is None else known.log_density * len(scene.indices)
        range_of_separations = math.log(10 * math.sqrt(2) * self.width / self.fineness)
        if not isinstance(scene, Binary):
            return math.log(max(1 - COMPANIONS * range_of_separations, COMPANIONS)) + colours
        separation, contrast = float(scene.separation), float(scene.contrast)
        within = float(log_ndtr((contrast - 1) / fit.error("contrast")))  # B is not the brighter
        density = COMPANIONS / (separation * 360.0 * contrast * math.log(FAINTEST))
        return math.log(density) + within + colours if contrast < FAINTEST else -math.inf
