"""The telescope: from a pupil, or a measured star, to the transfer function of the optics.

Reach for :func:`toliman_pupil` (extra ``toliman``) or :func:`obstructed_circle` first; then

    grid = grid_for(pupil, spectrum, shape=(128, 128), plate_scale=0.375)
    otf = expand(pupil, spectrum, grid)

with ``spectrum = flat_band(530, 640)``.  :func:`read_pupil` reads a pupil of your own,
:func:`pupil_from_dlux` takes one out of a dLux optical system, and :func:`empirical_otf` makes do
without one.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jitterkit.optics.anchor import Anchor
    from jitterkit.optics.anchored import AnchoredOptics, SelfAnchoringOptics
    from jitterkit.optics.colours import Colours, blackbody_index, colours_of
    from jitterkit.optics.empirical import empirical_otf
    from jitterkit.optics.expansion import expand, grid_for
    from jitterkit.optics.grid import DEFAULT_PAD, Grid
    from jitterkit.optics.otf import OTF
    from jitterkit.optics.pupil import Pupil, obstructed_circle
    from jitterkit.optics.pupil_file import read_pupil, write_pupil
    from jitterkit.optics.spectrum import Spectrum, flat_band, lines
    from jitterkit.optics.system import FixedOptics, OpticalSystem, Optics
    from jitterkit.optics.toliman import pupil_from_dlux, toliman_pupil

__all__ = [
    "DEFAULT_PAD",
    "OTF",
    "Anchor",
    "AnchoredOptics",
    "Colours",
    "FixedOptics",
    "Grid",
    "OpticalSystem",
    "Optics",
    "Pupil",
    "SelfAnchoringOptics",
    "Spectrum",
    "blackbody_index",
    "colours_of",
    "empirical_otf",
    "expand",
    "flat_band",
    "grid_for",
    "lines",
    "obstructed_circle",
    "pupil_from_dlux",
    "read_pupil",
    "toliman_pupil",
    "write_pupil",
]

_MODULES = (
    *("spectrum", "colours", "grid", "pupil", "pupil_file", "toliman"),
    *("otf", "expansion", "empirical", "system", "anchor", "anchored"),
)
"""Where the names are; the first three load no JAX, which takes half of the time of ``jitterkit info``."""


def __getattr__(name: str) -> Any:
    for module in _MODULES if name in __all__ else ():
        if hasattr(found := importlib.import_module(f"{__name__}.{module}"), name):
            return globals().setdefault(name, getattr(found, name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
