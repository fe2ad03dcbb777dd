"""A frame whose blur has been measured: the one record from which tables, pictures and kernels are made."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jitterkit.frames import Frame
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import axis_variances, covariance_on_axis

__all__ = ["Measured"]


@dataclass(frozen=True, eq=False)
class Measured:
    """What the image of one frame says about its blur.

    Attributes
    ----------
    frame : Frame
        In electrons, as far as its gain is known.
    estimate : KernelEstimate
        Lengths in arcsec where ``plate_scale`` is known, else in pixels.
    plate_scale : float or None
        arcsec per pixel.
    draw : callable
        Returns the three axes of its picture.
    length, length_err : float
        Of a streak; NaN where the estimate is not one.
    angle_err : float
        Of the major axis, degrees.
    message : str
        Verdict and conditions, in sentences.
    scene : str
        Name of the scene that the optics were fitted with; empty where there was none.
    """

    frame: Frame
    estimate: KernelEstimate
    plate_scale: float | None
    draw: Callable[[], list[Any]]
    length: float = math.nan
    length_err: float = math.nan
    angle_err: float = math.nan
    message: str = ""
    scene: str = ""

    @classmethod
    def of(
        cls,
        frame: Frame,
        estimate: KernelEstimate,
        plate_scale: float | None,
        draw: Callable[[], list[Any]],
        message: str = "",
        scene: str = "",
    ) -> Measured:
        """With the length of the estimate's locus and the errors that its covariance gives them.

        An estimate that does not say which data it was made from was made from the frame.
        """
        estimate = replace(estimate, source=estimate.source or frame.name)
        sizes = {} if estimate.locus is None else estimate.locus.describe()
        length = sizes.get("length", math.nan)
        major, minor, angle = axis_variances(estimate.moments)
        along, across, _ = map(float, np.sqrt(np.diag(covariance_on_axis(estimate.covariance, angle))))
        # of a streak the variance is proportional to the square of the length
        length_err = 0.5 * length * along / major if major > 0 else math.nan
        angle_err = math.degrees(across / (major - minor)) if major > minor else math.inf
        angle_err = min(angle_err, 90 / math.sqrt(3))  # at most that of a guess
        return cls(frame, estimate, plate_scale, draw, length, length_err, angle_err, message, scene)
