"""Motion at one frequency in the two axes of the detector, given as amplitudes and a phase between them.

Nature makes it as she makes every ellipse; engineers meet it in this form, because an attitude sensor
reports two axes and a spectrum of each.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.ellipse import Ellipse


class Lissajous(Ellipse):
    """``x = Ax cos t``, ``y = Ay cos(t + phase)`` over many cycles: an ellipse in other words.

    Its density, transfer function and fit coordinates are those of
    :class:`~jitterkit.loci.ellipse.Ellipse`; only what a person gives and is given back differs.
    """

    names: ClassVar[tuple[str, ...]] = ("lissajous_xx", "lissajous_xy", "lissajous_yy")

    @classmethod
    def of(cls, amplitude_x: float, amplitude_y: float, phase: float = 90.0) -> Self:
        """Build from the amplitudes [arcsec], zero to peak, and the phase between the axes [deg]."""
        if not (amplitude_x >= 0 and amplitude_y >= 0):
            problem = f"Amplitudes must not be negative, in arcsec; got {amplitude_x} and {amplitude_y}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        sxy = amplitude_x * amplitude_y * np.cos(np.radians(phase))
        return cls(jnp.asarray([amplitude_x**2, sxy, amplitude_y**2]) / 2)

    def describe(self) -> dict[str, float]:
        """``amplitude_x``, ``amplitude_y`` [arcsec] and ``phase`` [deg] in [0, 180]: its sign is lost."""
        sxx, sxy, syy = (float(s) for s in self.coords)
        x, y = np.sqrt(2 * max(sxx, 0.0)), np.sqrt(2 * max(syy, 0.0))
        phase = np.degrees(np.arctan2(np.sqrt(max(sxx * syy - sxy**2, 0.0)), sxy))
        return {"amplitude_x": float(x), "amplitude_y": float(y), "phase": float(phase)}
