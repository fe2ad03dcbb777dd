"""Jitter loci: the paths a pointing draws on the detector, as exact transfer functions."""

from jitterkit.errors import one_of
from jitterkit.loci.base import (
    Locus,
    Stable,
    axis_variances,
    covariance_on_axis,
    moments_on_axis,
    principal_axes,
)
from jitterkit.loci.cumulants import Skewed
from jitterkit.loci.elliptic import Ellipse, Lissajous, Mvn
from jitterkit.loci.kernel import jitter_cards, rasterise
from jitterkit.loci.partial import PartialShm
from jitterkit.loci.path import Path
from jitterkit.loci.product import Product, Smear, Tones
from jitterkit.loci.shaped import Shaped
from jitterkit.loci.streak import Linear, Shm, Streak
from jitterkit.loci.trace_file import is_trace, read_trace
from jitterkit.loci.trace_locus import Trace, trace_gaps

LOCI: dict[str, type[Locus]] = {
    "stable": Stable,
    "linear": Linear,
    "shm": Shm,
    "mvn": Mvn,
    "ellipse": Ellipse,
    "lissajous": Lissajous,
    "tones": Tones,
    "partial": PartialShm,
    "smear": Smear,
    "shaped": Shaped,
    "skewed": Skewed,
    "path": Path,
}
"""Every locus by name; a trace and a product are built, not named."""


def locus_class(name: str) -> type[Locus]:
    """Look a locus up by name.

    Raises
    ------
    ConfigurationError
        If there is none of that name; the message lists those there are.
    """
    return LOCI[one_of("jitter locus", name, LOCI)]


def locus_name(locus: Locus) -> str:
    """Return the name of a locus: that of the registry, where it is in it.

    >>> locus_name(PartialShm.of(0.3)), locus_name(Product(Linear.of(0.3), Mvn.of(0.1)))
    ('partial', 'linear*mvn')
    """
    if type(locus) is Product:
        return "*".join(locus_name(part) for part in locus.parts)
    names = {kind: name for name, kind in LOCI.items()}
    return names.get(type(locus), type(locus).__name__.lower())
