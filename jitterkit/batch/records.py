"""What becomes of one frame: the records that the steps hand on.

:class:`SceneEstimate` comes before everything of a frame is fitted, :class:`ProcessedFrame` after;
:class:`BlurMeasurement` is what ``jitterkit estimate`` has of a frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Frame, sky_position_angle
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn, axis_variances, covariance_on_axis
from jitterkit.optics import OTF, Optics
from jitterkit.refit import FitResult


@dataclass(frozen=True, eq=False)
class SceneEstimate:
    """Hold the starting point of a frame's fits: its stars are located, its blur is estimated.

    Attributes
    ----------
    data : Data
    parameters : Parameters
        Of the scene, with a normal locus.
    estimate : KernelEstimate
        Of that normal, until another takes its place.
    optics : Optics
    searched : OTF or None
        About aberrations very near the scene's, where it was searched for; None where the frame was
        registered to another, which tells too that the parameters describe it.
    ambiguity : str
        What else the frame may show that looks the same, in a sentence.
    fit : FitResult or None
        With the best of the loci, by the processor's options, where it has been made already.
    left_out : int
        Pixels that do not belong to the image, which the data are without.
    excess : float
        Of chi-squared, in its standard deviations, where the frame was registered to another: of the pixels
        that were used for that.
    correlated : str
        A sentence where the noise of such a frame is correlated.
    """

    data: Data
    parameters: Parameters
    estimate: KernelEstimate
    optics: Optics
    searched: OTF | None = None
    ambiguity: str = ""
    fit: FitResult | None = None
    left_out: int = 0
    excess: float = math.nan
    correlated: str = ""

    @cached_property
    def otf(self) -> OTF:
        """About aberrations very near the parameters'."""
        return self.optics.otf(self.parameters.aberrations) if self.searched is None else self.searched

    def blurred(self) -> np.ndarray:
        """Return the expected image (ny, nx) with the estimate's locus, or the normal with its moments."""
        estimate = self.estimate
        locus = Mvn.near(estimate.moments) if estimate.locus is None else estimate.locus
        return np.asarray(expected_image(self.parameters.with_locus(locus), self.otf))


@dataclass(frozen=True)
class ProcessedFrame:
    """A frame and what became of it.

    Attributes
    ----------
    frame : Frame or None
        In electrons, cut to the region that was fitted; None if it never got so far.
    result : FitResult
    pixel : (float, float)
        Position of the star, or midpoint of the pair, ``(x, y)``, 0-based pixels of the original frame; NaN
        where none was fitted.
    pa : float
        Direction from A to B on the sky, north through east [deg]; NaN without a WCS or a pair.
    """

    frame: Frame | None
    result: FitResult
    pixel: tuple[float, float] = (math.nan, math.nan)
    pa: float = math.nan

    @classmethod
    def from_fit(cls, frame: Frame, result: FitResult, plate_scale: float) -> ProcessedFrame:
        """Make the record of a frame, with the position and direction of its scene.

        Parameters
        ----------
        frame : Frame
        result : FitResult
        plate_scale : float
            arcsec per pixel.
        """
        if result.parameters is None:
            return cls(frame, result)
        scene, wcs, theta = result.parameters.scene, frame.metadata.wcs, result.of_scene("theta")
        x, y = (
            corner + (n - 1) / 2 + float(offset) / plate_scale
            for corner, n, offset in zip(frame.origin, frame.shape[::-1], (scene.x, scene.y), strict=True)
        )
        has_pa = wcs is not None and not math.isnan(theta)
        return cls(frame, result, (x, y), sky_position_angle(wcs, x, y, theta) if has_pa else math.nan)


@dataclass(frozen=True, eq=False)
class BlurMeasurement:
    """Hold the measured blur of one frame.

    Attributes
    ----------
    frame : Frame
        In electrons, as far as its gain is known.
    estimate : KernelEstimate
        Lengths in arcsec where ``plate_scale`` is known, else in pixels.
    plate_scale : float or None
        arcsec per pixel.
    evidence : SceneEstimate, FieldEstimate or (ny, nx) array
        What the estimate was made from, for its picture: a template, a field of stars, or an image.
    length, length_err : float
        Of a streak; NaN where the estimate is not one.
    angle_err : float
        Of the major axis, degrees.
    message : str
        Pattern and conditions, in sentences.
    scene : str
        Name of the scene that the optics were fitted with; empty where there was none.
    """

    frame: Frame
    estimate: KernelEstimate
    plate_scale: float | None
    evidence: Any
    length: float = math.nan
    length_err: float = math.nan
    angle_err: float = math.nan
    message: str = ""
    scene: str = ""

    @classmethod
    def from_estimate(
        cls,
        frame: Frame,
        estimate: KernelEstimate,
        plate_scale: float | None,
        evidence: Any,
        message: str = "",
        scene: str = "",
    ) -> BlurMeasurement:
        """Return a measurement with the length of the estimate's locus and the errors from its covariance.

        An estimate that does not say which data it was made from was made from the frame.
        """
        estimate = replace(estimate, source=estimate.source or frame.name)
        sizes = {} if estimate.locus is None else estimate.locus.describe()
        length = next((size for name, size in sizes.items() if name.endswith("length")), math.nan)
        major, minor, angle = axis_variances(estimate.moments)
        along, across, _ = map(float, np.sqrt(np.diag(covariance_on_axis(estimate.covariance, angle))))
        # of a streak the variance is proportional to the square of the length
        length_err = 0.5 * length * along / major if major > 0 else math.nan
        length_err = length_err if math.isnan(estimate.length_err) else estimate.length_err
        angle_err = math.degrees(across / (major - minor)) if major > minor else math.inf
        angle_err = min(angle_err, 90 / math.sqrt(3))  # at most that of a guess
        return cls(frame, estimate, plate_scale, evidence, length, length_err, angle_err, message, scene)
