"""A frame of a pair as the model has it, and its image with something changed: optics, wavefront or scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import numpy as np

from jitterkit.forward import Parameters, expected_image
from jitterkit.instruments import Instrument
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import FixedOptics, OpticalSystem
from jitterkit.scene import Scene, Star


@dataclass(frozen=True)
class Modelled:
    """A frame of a pair as the model has it.

    Attributes
    ----------
    telescope : Instrument
    parameters : Parameters
        Of a pair, with all that the optics know.
    optics : OpticalSystem or FixedOptics
    otf : OTF
        At the parameters' aberrations.
    """

    telescope: Instrument
    parameters: Parameters
    optics: OpticalSystem | FixedOptics
    otf: OTF

    @classmethod
    def of(cls, telescope: Instrument, parameters: Parameters) -> Modelled:
        """Model a telescope in front of a pair."""
        optics = telescope.system()
        otf = optics.otf(parameters.aberrations)
        return cls(telescope, parameters.completed(otf), optics, otf)

    @cached_property
    def image(self) -> np.ndarray:
        """Return the expected electrons (ny, nx)."""
        return np.asarray(expected_image(self.parameters, self.otf))

    def through(self, optics: OpticalSystem | FixedOptics) -> np.ndarray:
        """Return the image by other optics."""
        return np.asarray(expected_image(self.parameters, self._otf(optics)))

    def with_opd(self, opd: np.ndarray, scene: Star | None = None) -> np.ndarray:
        """Return the change of the image, or of that of one star, by a wavefront error (n, n) [nm]."""
        assert isinstance(self.optics, OpticalSystem)
        pupil = self.optics.pupil
        other = replace(self.optics, pupil=eqx.tree_at(lambda p: p.opd, pupil, pupil.opd + opd))
        if scene is None:
            return self.through(other) - self.image
        alone = of_sources(self.parameters, scene)
        before, after = (expected_image(alone, self._otf(optics)) for optics in (self.optics, other))
        return np.asarray(after - before)

    def of_scene(self, scene: Scene) -> np.ndarray:
        """Return the image of another scene."""
        return np.asarray(expected_image(of_sources(self.parameters, scene), self.otf))

    def _otf(self, optics: OpticalSystem | FixedOptics) -> OTF:
        return optics.otf(self.parameters.aberrations, derivatives=False)


def of_sources(parameters: Parameters, scene: Scene) -> Parameters:
    """Return the same frame of other sources, without background."""
    return Parameters(scene, parameters.locus, parameters.aberrations, diffusion=parameters.diffusion)
