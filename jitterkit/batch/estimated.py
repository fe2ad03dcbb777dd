"""What a frame shows before everything of it is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from jitterkit.estimators import KernelEstimate
from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.optics import OTF, Optics
from jitterkit.refit import FitResult

__all__ = ["Estimated"]


@dataclass
class Estimated:
    """What a frame shows before everything of it is fitted.

    Attributes
    ----------
    data : Data
    parameters : Parameters
        Of the scene, with a normal locus.
    estimate : KernelEstimate
    optics : Optics
    searched : OTF or None
        About aberrations very near the scene's, where it was searched for; None where the frame was
        registered to another, which tells too that the parameters describe it.
    doubt : str
        What else the frame may show that looks the same, in a sentence.
    fit : FitResult or None
        With the best of the loci, by the finder's options, where it has been made already.
    left_out : int
        Pixels that do not belong to the image, which the data are without.
    """

    data: Data
    parameters: Parameters
    estimate: KernelEstimate
    optics: Optics
    searched: OTF | None = None
    doubt: str = ""
    fit: FitResult | None = None
    left_out: int = 0

    @cached_property
    def otf(self) -> OTF:
        """About aberrations very near the parameters'."""
        return self.optics.otf(self.parameters.aberrations) if self.searched is None else self.searched
