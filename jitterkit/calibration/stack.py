"""A stack: frames of one kind and one exposure time, on disk or in memory.

Reach for :func:`open_stacks` for files, which looks at each frame once and puts those of one exposure
together, and for :meth:`Stack.of` for arrays.  :meth:`Stack.bands` gives the pixels of all frames, so many
rows at a time that they fit into the memory allowed: a file is read once for each band.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Any, Self

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import FrameFile, RawFrame, find_files, open_frames
from jitterkit.frames.duplicates import Duplicates

_SAMPLES = 65536
"""Pixels, about, from which the level of a frame is read: good to a thousandth of its noise."""

_OUTLYING, _LEAST_SCATTER = 5.0, 0.5
"""Scatters from the median beyond which a pixel does not count for the level, and the least scatter, ADU,
that whole numbers show."""

ROUNDING = 1 / 12
"""Variance of a converter to whole numbers [ADU²]: of a uniform law of width one.  It holds to 10 % of itself
at a noise of 0.5 ADU and to 40 % at 0.4, and better over pixels whose levels differ by a fraction of one."""

_PILED = 0.02
"""Share of the pixels at one and the same largest value from which a frame is saturated, or cut at zero; a
normal of one ADU has 0.02 % there."""


@dataclass(frozen=True)
class Shot:
    """One frame of a stack, before its pixels are read again.

    Parameters
    ----------
    name : str
        ``"flat.fits"``, or ``"flats.fits[3]"``.
    level, scatter : float
        Mean of its pixels without outliers, and 1.4826 times their median deviation [ADU].
    piled : float
        Share of its pixels at its largest value.
    floored : float
        Share of its pixels that are zero, if none is negative.
    exposure, gain : float, optional
        As its header says [s], [e-/ADU].
    whole : bool
        Whether its pixels are whole numbers.
    path : Path, optional
    index : int
        Place in its file.
    digest : str
        Of the pixels from which the level was read; empty where they are all alike.
    warnings : tuple of str
        Of its file.
    settings : mapping
        Cards of its header on the camera, by :func:`settings_of`.
    """

    name: str
    level: float
    scatter: float
    piled: float = 0.0
    floored: float = 0.0
    exposure: float | None = None
    gain: float | None = None
    whole: bool = True
    path: Path | None = None
    index: int = 0
    digest: str = ""
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def saturated(self) -> bool:
        """Return whether its pixels pile up at one value, the largest."""
        return self.piled > _PILED

    @property
    def clipped(self) -> bool:
        """Return whether its pixels pile up at zero."""
        return self.floored > _PILED


@dataclass(frozen=True, eq=False)
class Stack:
    """Frames of one kind and one exposure.

    Parameters
    ----------
    kind : {"bias", "dark", "flat"}
    shots : tuple of Shot
    shape : (int, int)
    dtype : numpy.dtype
        In which the pixels are held.
    exposure : float, optional
        Of each frame [s].
    unusable : (ny, nx) bool array
        True where a pixel is blank or not finite in any of the frames.
    pixels : (n, ny, nx) array, optional
        Of a stack in memory.
    """

    kind: str
    shots: tuple[Shot, ...]
    shape: tuple[int, int]
    dtype: np.dtype
    exposure: float | None
    unusable: np.ndarray
    pixels: np.ndarray | None = None

    @classmethod
    def of(cls, kind: str, pixels: Any, exposure: float | None = None) -> Self:
        """Make a stack of an array ``(n, ny, nx)`` [ADU].

        Raises
        ------
        ConfigurationError
            If it is not three-dimensional.
        """
        array = np.asarray(pixels)
        if array.ndim != 3 or 0 in array.shape:
            problem = f"the {kind} frames have shape {array.shape}; give one array (n, ny, nx)."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        blank = ~np.isfinite(array).all(axis=0)
        array = np.where(blank, 0.0, array) if blank.any() else array
        shots = tuple(look(f"{kind}[{i}]", plane, exposure) for i, plane in enumerate(array))
        return cls(kind, shots, array.shape[1:], array.dtype, exposure, blank, array)

    def __len__(self) -> int:
        return len(self.shots)

    @property
    def level(self) -> float:
        """Return the median of the levels of the frames [ADU]."""
        return float(np.median([shot.level for shot in self.shots]))

    @property
    def rounding(self) -> float:
        """Variance that the converter adds by rounding to whole numbers [ADU²]; none where they are not."""
        return ROUNDING if all(shot.whole for shot in self.shots) else 0.0

    @property
    def name(self) -> str:
        """Return ``"flat, 0.5 s"``."""
        return self.kind if self.exposure is None else f"{self.kind}, {self.exposure:g} s"

    def take(self, indices: Iterable[int]) -> Self:
        """Return the stack of some of the frames."""
        chosen = list(indices)
        pixels = None if self.pixels is None else self.pixels[chosen]
        return replace(self, shots=tuple(self.shots[i] for i in chosen), pixels=pixels)

    def bands(self, memory: float, multiple: int) -> Iterator[tuple[int, np.ndarray]]:
        """Give all frames a band of rows at a time.

        Parameters
        ----------
        memory : float
            Bytes that a band may take.
        multiple : int
            Of which the number of rows in a band is a multiple, one at least.

        Yields
        ------
        first : int
            Row at which the band begins.
        pixels : (n, rows, nx) array
        """
        ny, nx = self.shape
        rows = int(memory // (len(self) * nx * self.dtype.itemsize)) // multiple * multiple
        rows = max(rows, multiple)
        for first in range(0, ny, rows):
            last = min(first + rows, ny)
            yield first, self._read(first, last) if self.pixels is None else self.pixels[:, first:last]

    def _read(self, first: int, last: int) -> np.ndarray:
        band = np.empty((len(self), last - first, self.shape[1]), self.dtype)
        numbered = enumerate(self.shots)
        for path, members in groupby(numbered, key=lambda member: member[1].path):
            with open_frames(Path(str(path))) as file:
                for index, shot in members:
                    band[index] = file[shot.index].data[first:last]
        return band


def look(name: str, data: np.ndarray, exposure: float | None) -> Shot:
    """Look at a frame: its level, and how its pixels lie about it."""
    step = max(1, int((data.size / _SAMPLES) ** 0.5))
    sample = np.asarray(data[step // 2 :: step, step // 2 :: step], dtype=float)
    middle = float(np.median(sample))
    scatter = max(1.4826 * float(np.median(np.abs(sample - middle))), _LEAST_SCATTER)
    level = float(np.mean(sample[np.abs(sample - middle) <= _OUTLYING * scatter]))
    whole = bool(np.all(sample == np.rint(sample)))
    piled = float(np.mean(sample == sample.max()))
    digest = sha256(sample.tobytes()).hexdigest() if np.ptp(sample) else ""
    floored = float(np.mean(sample == 0)) if sample.min() == 0 else 0.0
    return Shot(name, level, scatter, piled, floored, exposure, whole=whole, digest=digest)


_SAME_EXPOSURE = 1e-6
"""Relative; exposures nearer than that are one."""


def open_stacks(kind: str, paths: Iterable[str | Path], exposure: float | None = None) -> tuple[Stack, ...]:
    """Look at frames of one kind and group them by their exposure.

    Parameters
    ----------
    kind : {"bias", "dark", "flat"}
        Biases are one stack, whatever exposure their headers say.
    paths : iterable of str or Path
        FITS or TIFF files, or directories of them; all frames of a cube count.
    exposure : float, optional
        Of all of them [s], whatever their headers say.

    Returns
    -------
    stacks : tuple of Stack
        The shortest exposure first.

    Raises
    ------
    FrameError
        If a file cannot be read or holds images of several detectors, or a frame has another shape than the
        first, is in electrons, is of another kind by its header, or has the pixels of an earlier one and is
        no saturated flat.
    ConfigurationError
        If a dark or flat has no exposure, or an exposure has one frame only.
    """
    shots: list[Shot] = []
    unusable: np.ndarray | None = None
    dtypes, known = set(), Duplicates()
    for path in find_files(paths):
        with open_frames(path) as file:
            dtypes.add(file.dtype)
            for raw in file:
                _check(raw, kind, unusable, file.hdu)
                unusable = raw.mask if unusable is None else unusable | raw.mask
                shots.append(shot := _seen(raw, kind, exposure, file))
                where = str(path.with_name(raw.name))
                digest = "" if kind == "flat" and shot.saturated else shot.digest  # full pixels are alike
                if first := known.original(digest, where):
                    problem = f"has the pixels of {first}, and copies have no noise between them"
                    remedy = f"leave it out of the {kind} frames"
                    raise FrameError(ErrorCode.DUPLICATE, where, problem, remedy)
    if unusable is None:
        raise ConfigurationError(ErrorCode.NO_IMAGE, f"there is no {kind} frame; name files that hold some.")
    dtype = np.result_type(*dtypes)
    groups = _grouped(shots)
    for group in groups:
        if len(group) < 2:
            at = "" if group[0].exposure is None else f" of {group[0].exposure:g} s"
            problem = f"{group[0].path}: there is one {kind} frame{at}"
            remedy = "give at least two, better ten or more, so that their noise is seen"
            raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; {remedy}.")
    ny, nx = unusable.shape
    return tuple(Stack(kind, group, (ny, nx), dtype, group[0].exposure, unusable) for group in groups)


def _check(raw: RawFrame, kind: str, earlier: np.ndarray | None, hdu: int | None) -> None:
    where = raw.path or raw.name
    if raw.hdu != hdu:
        problem = f"holds images of several detectors (HDU {hdu} and HDU {raw.hdu})"
        raise FrameError(ErrorCode.UNSUPPORTED, where, problem, "write each detector into files of its own")
    if raw.unit != "adu":
        remedy = f"give the {kind} frames as they were read, in ADU"
        raise FrameError(ErrorCode.UNKNOWN_UNIT, where, f"is in {raw.unit}", remedy)
    if earlier is not None and raw.shape != earlier.shape:
        (ny, nx), (rows, columns) = raw.shape, earlier.shape
        problem = f"has {nx} x {ny} pixels, the {kind} frames before it {columns} x {rows}"
        raise FrameError(ErrorCode.WRONG_SHAPE, where, problem, "give frames of one size")


def _seen(raw: RawFrame, kind: str, exposure: float | None, file: FrameFile) -> Shot:
    unlike = check_kind(raw, kind, file.text)
    seconds = None if kind == "bias" else exposure
    if kind != "bias" and seconds is None:
        seconds = raw.metadata.value("exposure")
        if seconds is None:
            problem = f"{raw.path}: the {kind} frame does not say its exposure; give --exposure in s."
            raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    if kind == "flat" and seconds is not None and not seconds > 0:
        problem = f"{raw.path}: the flat frame has an exposure of {seconds:g} s; give --exposure in s."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    shot, known = look(raw.name, raw.data, seconds), raw.metadata
    shot = replace(shot, path=raw.path, index=raw.index, gain=known.value("gain"))
    settings = settings_of(file.text)
    if known.bias is not None and "was subtracted" in known.bias.source:
        settings[WITHOUT_BIAS] = known.bias.source
    return replace(shot, warnings=(*known.warnings, *unlike), settings=settings)


def _grouped(shots: list[Shot]) -> list[tuple[Shot, ...]]:
    """Shots by exposure, rising; those of one exposure in the order they came."""
    groups: list[list[Shot]] = []
    for shot in sorted(shots, key=lambda shot: shot.exposure or 0.0):
        before = groups[-1][0].exposure or 0.0 if groups else None
        if before is not None and (shot.exposure or 0.0) <= before * (1 + _SAME_EXPOSURE):
            groups[-1].append(shot)
        else:
            groups.append([shot])
    return [tuple(group) for group in groups]


_KIND_CARDS = (
    "IMAGETYP", "OBSTYPE", "FRAME", "FRAMETYP", "IMTYPE", "EXP_TYPE", "VIMTYPE", "ESO DPR TYPE",
)  # fmt: skip

_KINDS: Mapping[str, str] = {
    "dark": r"flat[ _-]?dark|dark[ _-]?flat|dark",
    "bias": r"bias|zero|offset",
    "flat": r"flat|twilight",
    "light": r"light|object|science|target",
}
"""What the text of such a card says of a kind; the first that matches counts."""

_UNEXPOSED = 1.0
"""Seconds below which a dark may stand for a bias frame: many cameras take none of zero."""

SETTINGS = (
    "INSTRUME", "DETNAM", "XBINNING", "YBINNING", "CCDSUM", "BINNING", "GAIN", "OFFSET", "BLKLEVEL",
    "READOUTM", "READMODE", "RDMODE",
)  # fmt: skip
"""Cards that are alike in frames of one camera at one setting."""

TEMPERATURE, FILTER = "CCD-TEMP", "FILTER"

WITHOUT_BIAS = "without bias"
"""Setting of a frame whose header says that its bias was subtracted: the card."""


def check_kind(raw: RawFrame, kind: str, text: Callable[[str], str]) -> tuple[str, ...]:
    """Refuse a frame that its header calls a calibration frame of another kind.

    Parameters
    ----------
    raw : RawFrame
    kind : {"bias", "dark", "flat"}
        What it is given as.
    text : callable
        Returns the text of a card, empty where there is none.

    Returns
    -------
    warnings : tuple of str
        One if the header calls it a light frame, as programs call any frame.

    Raises
    ------
    FrameError
    """
    card, said = next(((card, text(card)) for card in _KIND_CARDS if text(card)), ("", ""))
    other = next((name for name, pattern in _KINDS.items() if re.search(pattern, said, re.I)), kind)
    unexposed = (raw.metadata.value("exposure") or 0.0) < _UNEXPOSED
    if other == kind or (kind == "bias" and other == "dark" and unexposed):
        return ()
    name = f"{card} = {said!r}"
    if other == "light":
        return (f"{name} says that they are not {kind} frames",)
    problem = f"is given as a {kind} frame, and is none by {name}"
    remedy = f"leave it out of the {kind} frames, or correct {card}"
    raise FrameError(ErrorCode.WRONG_INSTRUMENT, raw.path or raw.name, problem, remedy)


def settings_of(text: Callable[[str], str]) -> dict[str, str]:
    """Return what a header says of the camera: its settings, temperature and filter, those that it has."""
    return {card: said for card in (*SETTINGS, TEMPERATURE, FILTER) if (said := text(card))}


def differ(one: str, other: str) -> bool:
    """Return whether two texts of a card differ, and not only in how a number or a case is written.

    >>> differ("1", "1.0"), differ("1 1", "1x1"), differ("High Gain", "Low Gain")
    (False, False, True)
    """
    a, b = (re.split(r"[\s,x]+", text.strip().lower()) for text in (one, other))
    return len(a) != len(b) or any(_unlike(*pair) for pair in zip(a, b, strict=True))


def _unlike(one: str, other: str) -> bool:
    try:
        a, b = float(one), float(other)
    except ValueError:
        return one != other
    return abs(a - b) > 1e-3 * max(abs(a), abs(b))
