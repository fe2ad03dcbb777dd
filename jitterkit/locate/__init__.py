"""Finding the stars, and starting values for everything else."""

from jitterkit.locate.pair import FoundPair, find_pairs, find_star, residual_star, resolution
from jitterkit.locate.start import Start, locate_binary, locate_star, polished, with_best_signs
from jitterkit.locate.warm import ReferenceFrame, WarmStart

__all__ = [
    "FoundPair",
    "ReferenceFrame",
    "Start",
    "WarmStart",
    "find_pairs",
    "find_star",
    "locate_binary",
    "locate_star",
    "polished",
    "residual_star",
    "resolution",
    "with_best_signs",
]
