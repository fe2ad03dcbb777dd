"""Instruments: a telescope, its light and its detector, as a preset or a TOML file.

``load_instrument("toliman")`` and ``load_instrument("my.toml")`` are the two ways in;
:func:`instrument_from_fits` makes such a file of a PSF or a pupil.  Importing this
package, reading an instrument and resolving a frame's metadata with it load no JAX; only
:meth:`Instrument.optics` and :attr:`Instrument.pupil` do.
"""

from jitterkit.instruments.from_fits import instrument_from_fits
from jitterkit.instruments.instrument import Instrument
from jitterkit.instruments.presets import PRESETS
from jitterkit.instruments.resolve import resolve
from jitterkit.instruments.toml import load_instrument, read_instrument
