"""Finding the stars, and starting values for everything else."""

from jitterkit.locate.pair import FoundPair, find_pairs
from jitterkit.locate.start import Start, locate_binary
from jitterkit.locate.warm import ReferenceFrame, WarmStart

__all__ = ["FoundPair", "ReferenceFrame", "Start", "WarmStart", "find_pairs", "locate_binary"]
