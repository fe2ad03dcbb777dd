"""Finding the stars, and starting values for everything else."""

from jitterkit.locate.matched_filter import resolution
from jitterkit.locate.model_error import AUTO, ModelError, allow_for_model, check_model_error, relative_error
from jitterkit.locate.pair import FoundPair, find_pairs, find_star
from jitterkit.locate.registration import RegistrationResult
from jitterkit.locate.residual import Residual, most_outliers
from jitterkit.locate.search import bright_stars, locate_binary, locate_star, locate_stars, with_further_stars
from jitterkit.locate.start import Start, polished, settled, with_best_signs
from jitterkit.locate.warm import ReferenceFrame

__all__ = [
    "AUTO",
    "FoundPair",
    "ModelError",
    "ReferenceFrame",
    "RegistrationResult",
    "Residual",
    "Start",
    "allow_for_model",
    "bright_stars",
    "check_model_error",
    "find_pairs",
    "find_star",
    "locate_binary",
    "locate_star",
    "locate_stars",
    "most_outliers",
    "polished",
    "relative_error",
    "resolution",
    "settled",
    "with_best_signs",
    "with_further_stars",
]
