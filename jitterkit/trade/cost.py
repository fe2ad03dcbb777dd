"""What settings cost, counted and not measured: to put them in order before any is tried."""

from __future__ import annotations

import math

from jitterkit.batch.plan import PLAN
from jitterkit.instruments import Instrument
from jitterkit.optics import Grid
from jitterkit.trade.fitting import TOGETHER
from jitterkit.trade.settings import Settings, own_pad

_FRAME = 1e5
"""Of a frame whatever its model: what 32 x 32 padded samples of a hundred parameters cost."""


def work(settings: Settings, instrument: Instrument, parameters: int, frames: int) -> float:
    """Operations that a frame takes, up to a factor.

    Parameters
    ----------
    settings : Settings
    instrument : Instrument
    parameters : int
        That are fitted, each a derivative of the padded image.
    frames : int
        In the run: they share what is computed once, and of few each computes it.

    Returns
    -------
    work : float

    Notes
    -----
    A fit is transforms of the padded frame, one a parameter; a look at the optics is transforms of the pupil,
    one for each wavelength and aberration.  Within a quarter of the times of 17 settings, of 48 x 48 to
    320 x 320 padded pixels and 10 to 15 parameters.
    """
    ny, nx = (min(n, settings.region or n) for n in instrument.shape)
    pad = own_pad(instrument) if settings.pad is None else settings.pad
    padded = math.prod(Grid((ny, nx), instrument.plate_scale, pad).fine_shape)
    fit = _FRAME + (parameters - len(settings.without)) * padded
    if instrument.pupil is None or instrument.spectrum is None:
        return fit
    rays = instrument.pupil.opd.size / settings.binning**2 * (1 + len(instrument.aberrations))
    look = rays * (settings.samples or len(instrument.spectrum.wavelengths))
    return fit + look / (min(frames, TOGETHER) if frames >= PLAN.fewest else 1)
