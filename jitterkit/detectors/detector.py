"""A detector: what stands between the electrons of an image and the numbers of a file.

One object works in both directions.  :meth:`Detector.expose` makes numbers of an expected image, in the
order nature does: photons arrive, the well fills, the amplifier adds noise, the converter rounds and
runs out of bits (:mod:`jitterkit.detectors.readout`).  :meth:`Detector.calibrate` goes back, and says for
every pixel how far it is to be trusted (:mod:`jitterkit.detectors.reduction`).  A frame that knows its own
gain or noise keeps it; :meth:`Detector.inform` lays the detector's numbers underneath, by the ranks of
:mod:`jitterkit.frames.metadata`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.detectors.characteristics import Characteristics
from jitterkit.detectors.knowledge import inform
from jitterkit.detectors.readout import read_out
from jitterkit.detectors.reduction import reduce
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.metadata import Metadata


@dataclass(frozen=True, eq=False)
class Detector(Characteristics):
    """A detector that reads out and calibrates.

    Parameters
    ----------
    **characteristics
        Numbers and maps: the fields of
        :class:`~jitterkit.detectors.characteristics.Characteristics`, each None where it is not known.

    Raises
    ------
    ConfigurationError
        If a value is impossible; the message says what is possible.
    """

    def inform(self, metadata: Metadata) -> Metadata:
        """Add what the detector knows to what is known about a frame.

        Parameters
        ----------
        metadata : Metadata

        Returns
        -------
        metadata : Metadata
            With gain, read noise and bias, assumed if need be and a map by its median, with a saturation
            level if anything sets one, and with the time between rows, in the order of the image's rows.
            A frame keeps what it says of itself, by rank.  Doing it twice changes nothing.
        """
        return inform(self, metadata)

    def calibrate(self, raw: RawFrame) -> Frame:
        """Turn a frame as it was read into electrons.

        Parameters
        ----------
        raw : RawFrame
            Its ``origin`` places it under the maps.  A frame whose unit is electrons is taken as finished:
            it is neither scaled nor made linear, decoupled, freed of dark current or divided by the flat.

        Returns
        -------
        frame : Frame
            ``read_variance`` is the read noise squared and, where ADU were converted, the rounding's
            ``gain²/12``, both as the steps that follow enlarge them, and the expected dark electrons.
            The mask adds bad, dead and saturated pixels to the frame's own and, with coupling, the
            neighbours of those whose reading is not known.  ``flags``: ``gain_assumed``,
            ``read_noise_assumed`` and ``bias_assumed`` where neither the frame, nor a file, nor the user
            said it; ``saturated``; ``above_adc_range`` where a value is beyond this detector's bits, so
            that it must come from another; ``dark_not_subtracted`` where the exposure is not known.

        Raises
        ------
        FrameError
            If a map does not cover the frame.

        Notes
        -----
        Masking by the data cuts the upper tail of a pixel within a few sigma of saturation: a fit that
        uses it when it is not masked meets it low by at most 0.4 of its noise, on average over frames.
        Of a map and the one number that a frame says of itself the map is used where the number is the
        map's median.  *Fails when* a converter ends below the full well of a coupled detector: the
        ceiling is then that of an even surface.
        """
        return reduce(self, raw)

    def expose(
        self,
        expected: np.ndarray,
        rng: np.random.Generator | None = None,
        *,
        exposure: float | None = None,
        origin: tuple[int, int] = (0, 0),
    ) -> np.ndarray:
        """Read an expected image out, as the detector would.

        Parameters
        ----------
        expected : (ny, nx) array
            Electrons expected of an even detector; a negative one (ringing of a model) counts as none.
        rng : numpy.random.Generator, optional
            Draws the noise and the cosmic rays; without it there are none, but wells still fill and the
            converter rounds.
        exposure : float, optional
            s; dark current and cosmic rays need it.
        origin : (int, int)
            ``(x0, y0)`` of the image on the detector, for its maps.

        Returns
        -------
        readings : (ny, nx) array of int
            ADU; uint16 or uint32 where the bits are known, else int32, or int64 where need be.

        Raises
        ------
        ConfigurationError
            If the exposure is needed and not given.
        FrameError
            If a map does not cover the image.

        Notes
        -----
        Bad pixels respond like the others: the map only says not to trust them.  ``diffusion`` and
        ``line_time`` belong to the image's formation and are in the forward model.
        """
        return read_out(self, expected, rng, exposure, origin)
