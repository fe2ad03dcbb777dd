"""Finding the stars, and starting values for everything else."""

from jitterkit.locate.pair import FoundPair, find_pairs
from jitterkit.locate.start import Start, locate_binary

__all__ = ["FoundPair", "Start", "find_pairs", "locate_binary"]
