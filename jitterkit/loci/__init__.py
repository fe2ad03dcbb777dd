"""Jitter loci: the paths a pointing draws on the detector, as exact transfer functions."""

from jitterkit.errors import ConfigurationError
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.loci.kernel import rasterise
from jitterkit.loci.linear import Linear
from jitterkit.loci.mvn import Mvn
from jitterkit.loci.product import Product
from jitterkit.loci.shm import Shm
from jitterkit.loci.stable import Stable
from jitterkit.loci.streak import Streak

__all__ = [
    "LOCI",
    "Linear",
    "Locus",
    "Mvn",
    "Product",
    "Shm",
    "Stable",
    "Streak",
    "locus_class",
    "principal_axes",
    "rasterise",
]

LOCI: dict[str, type[Locus]] = {"stable": Stable, "linear": Linear, "shm": Shm, "mvn": Mvn}
"""Every locus by name, simplest first."""


def locus_class(name: str) -> type[Locus]:
    """Look a locus up by name.

    Raises
    ------
    ConfigurationError
        If there is none of that name; the message lists those there are.
    """
    try:
        return LOCI[name]
    except KeyError:
        raise ConfigurationError(
            f"There is no jitter locus {name!r}; choose from {', '.join(LOCI)}."
        ) from None
