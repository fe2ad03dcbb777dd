"""The two records of an image: as it was read, and in electrons.

:class:`RawFrame` is what the readers return: the numbers of the file with a mask and what is known
about them.  A detector turns it into a :class:`Frame`, the record everything downstream works on.
Both are cut with ``region`` and never forget where in the original frame they came from.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.frames.beside import ALL_BITS, convertible, rows_from_the_top, unit_of, variance_of
from jitterkit.frames.cards import Cards
from jitterkit.frames.header import resolve
from jitterkit.frames.metadata import Metadata
from jitterkit.frames.placed import NONE_MASKED, Placed, image_of, matching
from jitterkit.frames.sky import turned_over, usable_part

NO_READING = 1e15
"""No converter has 50 bits; programs write 1e30, or the largest number of all, where a pixel has no value."""


@dataclass(frozen=True, eq=False)
class RawFrame(Placed):
    """One image as a file holds it.

    Parameters
    ----------
    data : (ny, nx) float64 array
        Pixel values in ``metadata.unit`` (ADU where it is None); row index upwards.  Values that are not
        finite, or beyond :data:`NO_READING`, are set to 0 and masked.
    mask : (ny, nx) bool array, optional
        True where a pixel is unusable.
    metadata : Metadata
        What is known, with sources.
    path : Path, optional
        The file; None for an array.
    index : int
        Place of the frame in the file, from 0.
    hdu : int, optional
        The FITS HDU it was read from.
    origin : (int, int)
        ``(x0, y0)`` of ``data[0, 0]`` in the original frame.
    several : bool
        True if the file holds other frames too; then ``name`` carries the index.
    variance : (ny, nx) array, optional
        Variance of ``data`` in its unit squared, the photon noise of the data mostly included, as pipelines
        give it.  A pixel whose variance is not finite and positive is masked.
    variance_source : str
        Where the variance comes from: ``"ERR (HDU 2)"``.
    weighted : bool
        Whether the variance is the inverse of a weight, which may be a relative one.
    quality : (ny, nx) array of int, optional
        Bits of each pixel; ``metadata.bad_bits`` says which of them mask it.  Kept as int64, -1 where a pixel
        is masked for another reason.
    after : int, optional
        How many frames before it share its time; by default ``index``.

    Raises
    ------
    JitterkitError
        If the data are not two-dimensional or another array has another shape.
    """

    data: np.ndarray
    mask: np.ndarray = field(default_factory=lambda: NONE_MASKED)
    metadata: Metadata = field(default_factory=Metadata)
    path: Path | None = None
    index: int = 0
    hdu: int | None = None
    origin: tuple[int, int] = (0, 0)
    several: bool = False
    variance: np.ndarray | None = None
    variance_source: str = "argument variance"
    weighted: bool = False
    quality: np.ndarray | None = None
    after: int | None = None

    def __post_init__(self) -> None:
        data = image_of("data", self.data)
        mask = matching("mask", self.mask, data.shape, bool)
        bad = ~(np.abs(data) < NO_READING)  # of NaN too
        if bad.any():
            data, mask = np.where(bad, 0.0, data), mask | bad
        if self.variance is not None:
            variance = matching("variance", self.variance, data.shape, np.float64)
            unknown = ~(np.isfinite(variance) & (variance > 0))
            mask = mask | unknown
            object.__setattr__(self, "variance", np.where(unknown, 0.0, variance))
        if self.quality is not None:
            quality = matching("quality", self.quality, data.shape, np.int64)
            quality = np.where(mask & ~self._flagged(quality), -1, quality)
            object.__setattr__(self, "quality", quality)
            mask = self._flagged(quality)
        object.__setattr__(self, "data", data)
        object.__setattr__(self, "mask", mask)

    def _flagged(self, quality: np.ndarray) -> np.ndarray:
        return (quality < 0) | (quality & int(self.metadata.value("bad_bits", ALL_BITS)) != 0)

    def with_metadata(self, metadata: Metadata) -> RawFrame:
        """Return the same pixels, of which other things are known; its ``bad_bits`` choose the mask."""
        other = self.with_fields(metadata=metadata)
        if other.quality is not None:
            vars(other)["mask"] = other._flagged(other.quality)
        return other

    @property
    def unit(self) -> str:
        """``"adu"``, ``"electron"`` or another; ADU where nothing is known."""
        return self.metadata.value("unit", "adu")

    @cached_property
    def digest(self) -> str:
        """Return what the pixels are known by, whatever their file is called: 16 hexadecimal digits.

        Of the values and the shape alone: packing, byte order and the type they are stored in make no
        difference, nor does the rounding to 32 bits, in which programs store what they computed in 64.  A
        region has its own.
        """
        found = hashlib.sha256(f"{self.data.shape}".encode())
        rounded = self.data.astype(np.float32) + np.float32(0)  # -0 is 0
        found.update(np.ascontiguousarray(rounded, dtype="<f8").data)
        return found.hexdigest()[:16]

    @classmethod
    def from_array(
        cls, array: Any, *, mask: Any = None, variance: Any = None, source: str = "argument", **metadata: Any
    ) -> RawFrame:
        """Make a frame of a bare array.

        Parameters
        ----------
        array : (ny, nx) array_like
            Any real type and byte order; of a masked array the mask is kept.
        mask : (ny, nx) bool array_like, optional
            True where a pixel is unusable, beside what is not finite.
        variance : (ny, nx) array_like, optional
            Of the array, its photon noise included.
        source : str
            The word to record for the metadata.
        **metadata
            Fields of :class:`Metadata`: ``exposure=1.0, gain=3.7, unit="electron"``.
        """
        _refuse_complex(array)
        own = np.ma.getmaskarray(array) if isinstance(array, np.ma.MaskedArray) else False
        data = np.array(np.ma.getdata(array), dtype=np.float64)
        both = own | np.asarray(False if mask is None else mask, dtype=bool)
        return cls(data, both, Metadata().override(source, **metadata), variance=variance)

    @classmethod
    def from_ccddata(cls, ccd: Any) -> RawFrame:
        """Make a frame of an ``astropy.nddata.CCDData``, an ``NDData`` or anything that looks like one.

        Its ``data``, ``mask``, ``unit``, ``uncertainty``, ``header`` (or ``meta``) and ``wcs`` are read.
        With ``ROWORDER = 'TOP-DOWN'`` in its header its rows are turned over, as those of its file are.

        Raises
        ------
        JitterkitError
            If the unit is neither ADU, electrons, nor a rate of them, or the uncertainty has another unit
            (code ``unknown_unit``).
        """
        _refuse_complex(ccd.data)
        cards, unit = Cards(getattr(ccd, "header", None) or getattr(ccd, "meta", None) or {}), unit_of(ccd)
        data, variance, warning = np.array(ccd.data, dtype=np.float64), *variance_of(ccd)
        from_top, (wcs, messages) = rows_from_the_top(cards), _coordinates(ccd)
        if wcs is not None and from_top:
            wcs = turned_over(wcs, len(data))
        metadata = resolve(cards, wcs, unit).warn(*messages, *filter(None, [warning]))
        if metadata.unit is not None:
            convertible(str(metadata.unit.value), metadata.unit.source)
        elif getattr(ccd, "unit", None) is not None:
            metadata = metadata.warn("the unit is dimensionless and is taken as ADU")
        mask = getattr(ccd, "mask", None)
        source, mask = "argument uncertainty", NONE_MASKED if mask is None else np.asarray(mask)
        frame = cls(data, mask, metadata, variance=variance, variance_source=source)
        if not from_top:
            return frame
        planes = {name: getattr(frame, name)[::-1] for name in ("data", "mask")}
        variance = None if frame.variance is None else frame.variance[::-1]
        return replace(frame, **planes, variance=variance, metadata=metadata.reordered(-1))


def _coordinates(ccd: Any) -> tuple[Any | None, tuple[str, ...]]:
    """The celestial coordinates of an object, or none, with what was odd about them."""
    if getattr(ccd, "wcs", None) is None:
        return None, ()
    try:
        return usable_part(ccd.wcs)
    except Exception as error:  # of wcslib, and of objects that are no WCS of astropy, such as gwcs
        return None, (f"the WCS cannot be used ({type(error).__name__}) and is ignored",)


def _refuse_complex(array: Any) -> None:
    if np.iscomplexobj(array):
        raise JitterkitError(ErrorCode.WRONG_TYPE, "the array is complex; a frame holds real numbers.")


@dataclass(frozen=True, eq=False)
class Frame(Placed):
    """One image in electrons, ready to be fitted.

    Parameters
    ----------
    electrons : (ny, nx) float64 array
        Signal [e-] of an even detector: free of bias and dark current, linear, divided by ``response``;
        row index upwards.
    read_variance : (ny, nx) array or float
        Variance that the scene does not make [e-²], of the counts *before* the division by ``response``:
        read-out, rounding and dark current.  A number is spread over the image.
    mask : (ny, nx) bool array, optional
        True where a pixel is unusable.
    exposure : float, optional
        [s]
    plate_scale : float, optional
        [arcsec/pixel]
    metadata : Metadata
        Where each number came from.
    path, index, origin, several
        As in :class:`RawFrame`.
    digest : str
        That of the whole raw frame this was made from; empty where nobody said it.
    saturated : int
        How many of the masked pixels were saturated.
    flags : tuple of str
        What a reader of the results should know.
    response : (ny, nx) array or float
        The relative response (flat) by which the counts were divided; positive.
    ceiling : (ny, nx) array or float
        Level [e-, as ``electrons``] at and above which a count is only known to be at least that.
    full : (ny, nx) bool array, optional
        True where a pixel is masked for no other reason than being at or above the ceiling.

    Raises
    ------
    JitterkitError
        If shapes disagree, a variance is negative or not finite, or a scale or response is not positive.
    """

    electrons: np.ndarray
    read_variance: np.ndarray
    mask: np.ndarray = field(default_factory=lambda: NONE_MASKED)
    exposure: float | None = None
    plate_scale: float | None = None
    metadata: Metadata = field(default_factory=Metadata)
    path: Path | None = None
    index: int = 0
    origin: tuple[int, int] = (0, 0)
    several: bool = False
    digest: str = ""
    saturated: int = 0
    flags: tuple[str, ...] = ()
    response: np.ndarray | float = 1.0
    ceiling: np.ndarray | float = math.inf
    full: np.ndarray = field(default_factory=lambda: NONE_MASKED)

    def __post_init__(self) -> None:
        electrons = image_of("electrons", self.electrons)
        given = np.asarray(self.read_variance, dtype=np.float64)
        if not (np.isfinite(given) & (given >= 0)).all():
            problem = "read_variance has negative or non-finite values"
            raise JitterkitError(ErrorCode.OUT_OF_RANGE, f"{problem}; give variances in e-².")
        variance = matching("read_variance", given, electrons.shape, np.float64)
        mask = matching("mask", self.mask, electrons.shape, bool)
        finite = np.isfinite(electrons)
        object.__setattr__(self, "electrons", np.where(finite, electrons, 0.0))
        object.__setattr__(self, "read_variance", variance)
        object.__setattr__(self, "mask", mask | ~finite)
        object.__setattr__(self, "full", matching("full", self.full, electrons.shape, bool))
        for name in ("response", "ceiling"):
            value = getattr(self, name)  # one number stays one: it costs nothing where a detector is even
            value = float(value) if np.ndim(value) == 0 else matching(name, value, electrons.shape, float)
            object.__setattr__(self, name, value)
        if not (np.isfinite(self.response) & (np.asarray(self.response) > 0)).all():
            problem = "response has values that are not positive"
            raise JitterkitError(ErrorCode.OUT_OF_RANGE, f"{problem}; mask a dead pixel and give it 1.")
        for name, unit in (("exposure", "s"), ("plate_scale", "arcsec/pixel")):
            value = getattr(self, name)
            if value is not None and not (0 < value < math.inf or (name == "exposure" and value == 0)):
                problem = f"{name} = {value!r} {unit} is not positive; leave it None where it is unknown."
                raise JitterkitError(ErrorCode.OUT_OF_RANGE, problem)

    @property
    def light(self) -> float:
        """Return the sum of all pixels in use, e-; at least one."""
        return max(float(np.sum(self.electrons, where=~self.mask)), 1.0)

    @property
    def variance(self) -> np.ndarray:
        """Variance of ``electrons`` [e-²], its photon noise estimated from the data themselves.

        ``max(electrons, 0)/response + read_variance/response²``.
        """
        return np.maximum(self.electrons, 0.0) / self.response + self.read_variance / self.response**2
