"""A detector: what stands between the electrons of an image and the numbers of a file.

One object works in both directions.  :meth:`Detector.expose` makes numbers of an expected image, in the
order nature does: photons arrive, the well fills, the amplifier adds noise, the converter rounds and
runs out of bits.  :meth:`Detector.calibrate` goes back, and says for every pixel how far it is to be
trusted.  A frame that knows its own gain or noise keeps it; :meth:`Detector.inform` lays the detector's
numbers underneath, by the ranks of :mod:`jitterkit.frames.metadata`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jitterkit.detectors.checks import check_detector
from jitterkit.errors import FrameError
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.metadata import Known, Metadata

__all__ = ["ASSUMED", "Detector", "supplement"]

ASSUMED: Mapping[str, float] = {"gain": 1.0, "read_noise": 0.0, "bias": 0.0}
"""What is taken where nobody says: a counter of electrons without noise."""

_WELL_MARGIN = 5.0
"""Read-out sigmas below the full well from which a pixel counts as full: one in 3 million escapes."""


def supplement(metadata: Metadata, name: str, value: Any, source: str) -> Metadata:
    """Add a value to what is known about a frame, unless somebody as authoritative has spoken.

    Of two sources of one rank the one already there is heard: a frame is nearer to itself.
    """
    present: Known | None = getattr(metadata, name)
    if present is not None and present.rank <= Known(value, "", source).rank:
        return metadata
    return metadata.override(source, **{name: value})


@dataclass(frozen=True, eq=False)
class Detector:
    """The numbers that describe a detector; None where one is not known.

    Parameters
    ----------
    gain : float, optional
        e-/ADU.
    read_noise : float, optional
        Standard deviation of the read-out, e-, without that of rounding.
    bias : float, optional
        Reading of an unexposed pixel, ADU.
    full_well : float, optional
        Electrons a pixel holds.
    saturation : float, optional
        Level at and above which a pixel is not to be trusted, ADU.
    bits : int, optional
        Of the converter, which reads 0 to ``2**bits - 1``.
    bad_pixels : (ny, nx) bool array, optional
        True where a pixel is unusable, on the whole detector.
    sources : mapping, optional
        Where each number comes from, by its name; begin with a word of
        :data:`jitterkit.frames.metadata.RANKS`.

    Raises
    ------
    ConfigurationError
        If a value is impossible; the message says what is possible.
    """

    gain: float | None = None
    read_noise: float | None = None
    bias: float | None = None
    full_well: float | None = None
    saturation: float | None = None
    bits: int | None = None
    bad_pixels: np.ndarray | None = None
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_detector(vars(self))
        if self.bad_pixels is not None:
            object.__setattr__(self, "bad_pixels", np.asarray(self.bad_pixels, dtype=bool))

    def source(self, name: str) -> str:
        """Where a number comes from; ``"argument Detector"`` where nothing else was said."""
        return self.sources.get(name, "argument Detector")

    # -- from a file to electrons ------------------------------------------------------------------

    def inform(self, metadata: Metadata) -> Metadata:
        """Add what the detector knows to what is known about a frame.

        Parameters
        ----------
        metadata : Metadata

        Returns
        -------
        metadata : Metadata
            With gain, read noise and bias, assumed if need be, and with a saturation level if anything
            sets one; see :func:`supplement`.  Doing it twice changes nothing.
        """
        for name, assumed in ASSUMED.items():
            metadata = supplement(metadata, name, getattr(self, name), self.source(name))
            metadata = metadata.fill("assumed, as nothing says it", **{name: assumed})
        name, level = self._ceiling(metadata)
        # our own earlier word may rest on a gain that has been corrected since
        words = {self.source(name) for name in ("saturation", "full_well", "bits")}
        own = metadata.saturation is not None and metadata.saturation.source in words
        metadata = replace(metadata, saturation=None) if own else metadata
        return supplement(metadata, "saturation", None if math.isinf(level) else level, self.source(name))

    def calibrate(self, raw: RawFrame) -> Frame:
        """Turn a frame as it was read into electrons.

        Parameters
        ----------
        raw : RawFrame
            A frame whose unit is electrons is not scaled.

        Returns
        -------
        frame : Frame
            ``read_variance`` is the read noise squared and, where ADU were converted, the rounding's
            ``gain²/12``.  The mask adds bad and saturated pixels to the frame's own.  ``flags``:
            ``gain_assumed``, ``read_noise_assumed`` and ``bias_assumed`` where neither the frame, nor a
            file, nor the user said it; ``saturated``; ``above_adc_range`` where a value is beyond
            this detector's bits, so that it must come from another.

        Raises
        ------
        FrameError
            If the bad-pixel map does not cover the frame.

        Notes
        -----
        Masking by the data cuts the upper tail of a pixel within a few sigma of saturation: a fit that
        uses it when it is not masked meets it low by at most 0.4 of its noise, on average over frames.
        """
        metadata = self.inform(raw.metadata)
        converted = raw.unit == "adu"
        gain, noise, bias = (metadata.value(name) for name in ASSUMED)
        full = raw.data >= _in_unit_of(raw, metadata.saturation, gain, bias)
        return Frame(
            electrons=(raw.data - bias) * gain if converted else raw.data,
            read_variance=np.full(raw.shape, _read_variance(gain if converted else 0.0, noise)),
            mask=raw.mask | full | self._bad(raw),
            exposure=metadata.value("exposure"),
            plate_scale=metadata.value("plate_scale"),
            metadata=metadata,
            path=raw.path,
            index=raw.index,
            origin=raw.origin,
            several=raw.several,
            saturated=int(np.sum(full & ~raw.mask)),
            flags=self._flags(raw, metadata, bool(np.any(full & ~raw.mask))),
        )

    def _ceiling(self, metadata: Metadata) -> tuple[str, float]:
        """The lowest level that ends the range, ADU, and which of our numbers sets it."""
        gain, noise, bias = (metadata.value(name) for name in ASSUMED)
        levels = {"saturation": self.saturation if self.saturation is not None else math.inf}
        levels["bits"] = self._largest()
        if self.full_well is not None:
            margin = min(_WELL_MARGIN * _read_variance(gain, noise) ** 0.5, self.full_well / 2)
            levels["full_well"] = bias + (self.full_well - margin) / gain
        name = min(levels, key=lambda key: levels[key])
        return name, levels[name]

    def _largest(self) -> float:
        return math.inf if self.bits is None else 2.0**self.bits - 1

    def _bad(self, raw: RawFrame) -> np.ndarray:
        if self.bad_pixels is None:
            return np.zeros(raw.shape, dtype=bool)
        (x0, y0), (ny, nx) = raw.origin, raw.shape
        bad = self.bad_pixels[y0 : y0 + ny, x0 : x0 + nx]
        if bad.shape != raw.shape:
            height, width = self.bad_pixels.shape
            last = f"column {x0 + nx - 1}, row {y0 + ny - 1}"
            problem = f"ends at {last}, beyond the bad-pixel map of {width} x {height}"
            raise FrameError(raw.name, problem, "give a map of the whole detector, or none")
        return bad

    def _flags(self, raw: RawFrame, metadata: Metadata, saturated: bool) -> tuple[str, ...]:
        needed = ASSUMED if raw.unit == "adu" else ("read_noise",)
        flags = [f"{name}_assumed" for name in needed if _nobody_said(getattr(metadata, name))]
        beyond = raw.unit == "adu" and bool(np.any(raw.data[~raw.mask] > self._largest()))
        return (*flags, *["saturated"] * saturated, *["above_adc_range"] * beyond)

    # -- from electrons to a file ------------------------------------------------------------------

    def expose(self, expected: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
        """Read an expected image out, as the detector would.

        Parameters
        ----------
        expected : (ny, nx) array
            Expected electrons; a negative one (ringing of a model) counts as none.
        rng : numpy.random.Generator, optional
            Draws the noise; without it there is none, but wells still fill and the converter rounds.

        Returns
        -------
        readings : (ny, nx) array of int
            ADU; uint16 or uint32 where the bits are known, else int32 without a range.

        Notes
        -----
        Bad pixels respond like the others: the map only says not to trust them.
        """
        collected = self._collect(np.maximum(np.asarray(expected, dtype=float), 0.0), rng)
        return self._digitise(self._amplify(collected, rng))

    def _collect(self, expected: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        arrived = expected if rng is None else rng.poisson(expected).astype(float)
        return arrived if self.full_well is None else np.minimum(arrived, self.full_well)

    def _amplify(self, electrons: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        noise = self.read_noise or 0.0
        read = electrons if rng is None or noise == 0 else electrons + rng.normal(0.0, noise, electrons.shape)
        return (self.bias or 0.0) + read / (self.gain or ASSUMED["gain"])

    def _digitise(self, level: np.ndarray) -> np.ndarray:
        rounded = np.rint(level)
        if self.bits is None:
            return rounded.astype(np.int32)
        return np.clip(rounded, 0, self._largest()).astype(np.uint16 if self.bits <= 16 else np.uint32)


def _read_variance(gain: float, noise: float) -> float:
    """Read-out and rounding to whole ADU (a uniform law of width ``gain``), e-²."""
    return noise**2 + gain**2 / 12


def _nobody_said(known: Known) -> bool:
    return known.source.startswith(("preset", "assumed"))


def _in_unit_of(raw: RawFrame, saturation: Known | None, gain: float, bias: float) -> float:
    """The saturation level in the frame's unit; a header gives it in the unit of its own pixels."""
    if saturation is None:
        return math.inf
    if raw.unit == "adu" or saturation.source.startswith(("header", "sidecar")):
        return saturation.value
    return (saturation.value - bias) * gain
