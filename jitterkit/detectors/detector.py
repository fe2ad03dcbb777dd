"""A detector: what stands between the electrons of an image and the numbers of a file; those that come along.

One object works in both directions.  :meth:`Detector.expose` makes numbers of an expected image, in the
order nature does: photons arrive, the well fills, the amplifier adds noise, the converter rounds and
runs out of bits (:mod:`jitterkit.detectors.readout`).  :meth:`Detector.calibrate` goes back, and says for
every pixel how far it is to be trusted (:mod:`jitterkit.detectors.reduction`).  A frame that knows its own
gain or noise keeps it; :meth:`Detector.inform` lays the detector's numbers underneath, by the ranks of
:mod:`jitterkit.frames.metadata`.

``detector_preset("imx183")`` is the camera FLIR BFS-U3-200S6M: a Sony IMX183, 5472 x 3648 pixels of 2.4 um,
12 bits, rolling shutter.  Sony publishes no noise figures and we have no report by EMVA 1288 of this camera;
Balluff's (Matrix Vision's) of the mvBlueFOX3-2205, which holds the same sensor, gives SNRmax = 41.6 dB,
DNR = 71.5 dB and 22 frames/s of 3692 rows.  By EMVA 1288 that is

* a full well of 10^(41.6/10) = 14.5 ke-;
* a smallest signal of 10^(41.6/10 - 71.5/20) = 3.85 e- = 1/2 + sqrt(sigma² + 1/4), so that sigma is 3.3 e-
  with the converter's rounding and 3.1 e- without;
* 12.3 us from row to row at that camera's full speed.

What is not published and not measured is either called a choice or left out: there is no flat, no
non-linearity (amateurs find a QHY183M, with the same sensor, straight to 3400 of 4095 ADU), no coupling
and no diffusion.  Measure your own camera's and name its maps in an instrument file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jitterkit.detectors import readout, reduction
from jitterkit.detectors.characteristics import Characteristics
from jitterkit.detectors.file_variance import NORMALISED, in_counts, is_normalised, with_read_variance
from jitterkit.detectors.knowledge import ASSUMED, ceiling, piece, supplement
from jitterkit.errors import ConfigurationError, ErrorCode, one_of
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.metadata import ROWS_ARE_COLUMNS, Metadata


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
        for name, assumed in ASSUMED.items():
            metadata = supplement(metadata, name, self.nominal(name), self.source(name))
            if getattr(metadata, name) is None:
                metadata = metadata.override("assumed, as nothing says it", **{name: assumed})
        metadata = supplement(metadata, "bad_bits", self.bad_bits, self.source("bad_bits"))
        line_time, order = self.line_time, metadata.row_order
        if line_time and not order:
            metadata = metadata.warn(ROWS_ARE_COLUMNS)
        line_time = line_time * order if line_time else line_time
        metadata = supplement(metadata, "line_time", line_time, self.source("line_time"))
        name, level = ceiling(self, metadata)
        # our own earlier word may rest on a gain that has been corrected since
        words = {self.source(name) for name in ("saturation", "full_well", "bits")}
        stated = metadata.saturation is not None and metadata.saturation.source in words
        metadata = replace(metadata, saturation=None) if stated else metadata
        return supplement(metadata, "saturation", None if math.isinf(level) else level, self.source(name))

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
        normalised = is_normalised(raw)
        raw = in_counts(raw)
        metadata = self.inform(raw.metadata)
        raw = raw.with_metadata(replace(raw.metadata, bad_bits=metadata.bad_bits))
        if raw.variance is not None:
            raw = with_read_variance(raw, metadata)
            metadata = self.inform(raw.metadata)
        wrong, detector, is_adu = reduction.disproved(self, raw, metadata), self, raw.unit == "adu"
        if wrong:
            detector = replace(self, **wrong)
            metadata = detector.inform(raw.metadata)
        counts = (reduction.of_adu if is_adu else reduction.of_electrons)(detector, raw, metadata)
        where = raw.name, raw.origin, raw.shape
        flat = 1.0 if self.flat is None else piece("flat", self.flat, *where)
        bad = counts.unknown | np.asarray(flat <= 0)
        if self.bad_pixels is not None:
            bad = bad | np.asarray(piece("bad_pixels", self.bad_pixels, *where), dtype=bool)
        response = np.where(flat > 0, flat, 1.0) if is_adu and np.ndim(flat) else 1.0
        full = counts.full & ~raw.mask
        said = reduction.flags(self, raw, metadata, bool(np.any(full)), bool(wrong))
        return Frame(
            electrons=counts.electrons / response,
            read_variance=np.asarray(counts.variance),
            mask=raw.mask | counts.full | bad,
            exposure=metadata.value("exposure"),
            plate_scale=metadata.value("plate_scale"),
            metadata=metadata,
            path=raw.path,
            index=raw.index,
            origin=raw.origin,
            several=raw.several,
            saturated=int(np.sum(full)),
            flags=(*said, *[NORMALISED] * normalised),
            response=response,
            ceiling=counts.ceiling / response,
            full=full & ~bad,
        )

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
        for name in ("dark_current", *["cosmic_rays"] * (rng is not None)):
            value = getattr(self, name)
            if exposure is None and value is not None and np.any(value):
                problem = f"{name} needs the exposure of the frame; give exposure, in s."
                raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
        expected = np.maximum(np.asarray(expected, dtype=float), 0.0)
        charge = readout.collected(self, expected, rng, exposure, origin)
        return readout.digitised(self, readout.amplified(self, charge, rng, origin), origin)


_EMVA = "EMVA 1288 of Balluff's mvBlueFOX3-2205, same sensor"

_IMX183: Mapping[str, tuple[float, str]] = {
    "gain": (3.6, "an estimate: the well fills the converter's 4095 ADU"),
    "read_noise": (3.1, f"{_EMVA}: DNR 71.5 dB, less rounding"),
    "bias": (30.0, "a choice: 33 sigma above zero, and the well fills before the converter ends"),
    "full_well": (14500.0, f"{_EMVA}: SNRmax 41.6 dB"),
    "bits": (12, "Sony IMX183"),
    "dark_current": (1.0, "a choice: uncooled; 0.1 e- in 0.1 s"),
    "line_time": (15e-6, "an estimate: 18 frames/s of 3648 rows; the sensor's fastest is 12.3 us"),
}


def sourced_detector(preset: str, numbers: Mapping[str, tuple[float, str]]) -> Detector:
    """Make a detector of numbers that come each with its source."""
    sources = {name: f"preset {preset} ({words})" for name, (_, words) in numbers.items()}
    values: dict[str, Any] = {name: value for name, (value, _) in numbers.items()}
    return Detector(**values, sources=sources)


def imx183() -> Detector:
    """Return the camera FLIR BFS-U3-200S6M; the module's introduction says what is known of it."""
    return sourced_detector("imx183", _IMX183)


DETECTORS: Mapping[str, Callable[[], Detector]] = {"imx183": imx183}
"""Every detector by name."""


def detector_preset(name: str) -> Detector:
    """Make the detector of a name.

    Raises
    ------
    ConfigurationError
        If there is none; the message lists those there are.
    """
    return DETECTORS[one_of("detector", name, DETECTORS)]()
