"""The blur of frames for which there is no optical model: star fields, and scenes without stars.

Reach for :class:`SceneBlurEstimator`.  A sharp frame beside the blurred one is worth more than any
method: of a star field it gives the PSF, of any other scene the scene itself.  :func:`sharpest` finds
one in a set; :func:`check_reference` refuses one that is of no use before a long run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from jitterkit.batch.plan import Batch
from jitterkit.batch.records import BlurMeasurement
from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError, UndeterminedError
from jitterkit.extended import BLIND, estimate_from_reference, estimate_trail
from jitterkit.frames import Frame, RawFrame, find_files, open_frames
from jitterkit.kernels import fill_masked
from jitterkit.starfield import estimate_field, field_psf, roundest
from jitterkit.starfield.field import refuse_other_pixels

_CHANCE = 5.0
"""Standard errors by which the pixels of a scene are more like their neighbours than those of noise."""


def check_reference(
    sharp: Frame, starless: str | None, paths: Sequence[str | Path], hdu: int | None = None
) -> None:
    """Refuse a reference that cannot serve any frame.

    Parameters
    ----------
    sharp : Frame
    starless : str or None
        Of a star field, which need not have the size of the others: why no stars are seen in it, or nothing.
        None if it is a view of something else.
    paths : sequence of str or Path
        Files to be measured, or directories of them; no more is read than the sizes of their frames.
    hdu : int, optional

    Raises
    ------
    ConfigurationError
        If the reference shows nothing, has another size than every file, or is the only frame.
    """
    if sharp.mask.all():
        raise _refusal(ErrorCode.NO_DATA, sharp, "it has no usable pixel")
    if starless:
        raise _refusal(ErrorCode.NO_STAR, sharp, f"it shows no stars ({starless.rstrip('.')})")
    if starless is None:
        if not _shows_something(fill_masked(sharp.electrons, ~sharp.mask)):
            raise _refusal(ErrorCode.NO_SIGNAL, sharp, "it shows nothing but noise")
        sizes: list[tuple[str, tuple[int, int]]] = []
        for path in find_files(paths):
            with suppress(FrameError), open_frames(path, hdu=hdu) as file:
                sizes.append((path.name, file.shape))
            if sizes and sizes[-1][1] == sharp.shape:
                break
        else:
            if sizes:
                check_size(sharp, *sizes[0])
    alone = sharp.path is not None and not sharp.several
    if alone and {path.resolve() for path in find_files(paths)} == {Path(sharp.path).resolve()}:  # type: ignore[arg-type]
        problem = f"{sharp.name} is the reference and the only frame; give frames to compare with it."
        raise ConfigurationError(ErrorCode.BAD_REFERENCE, problem)


def check_size(sharp: Frame, name: str, size: tuple[int, int]) -> None:
    """Refuse a reference of another size ``(ny, nx)`` than a frame that shows the same view.

    Raises
    ------
    ConfigurationError
    """
    if size != sharp.shape:
        own, other = (f"{nx} x {ny}" for ny, nx in (sharp.shape, size))
        raise _refusal(ErrorCode.WRONG_SHAPE, sharp, f"it has {own} pixels, {name} {other}")


def sharpest(paths: Sequence[str | Path], hdu: int | None = None) -> RawFrame:
    """Return the frame of a set of star fields whose stars are sharpest: the others' reference.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, or directories of them; every frame that can be read is looked at.
    hdu : int, optional

    Raises
    ------
    UndeterminedError
        If no frame has three isolated stars.
    """
    frames: list[Frame] = []
    positions: list[tuple[Path, int]] = []
    for path in find_files(paths):
        with suppress(FrameError), open_frames(path, hdu=hdu) as file:  # its row will say what is wrong
            for raw in file:
                frames.append(Detector().calibrate(raw))
                positions.append((path, raw.index))
    path, index = positions[roundest(frames)]
    with open_frames(path, hdu=hdu) as file:
        return file[index]


def _refusal(code: ErrorCode, sharp: Frame, problem: str) -> ConfigurationError:
    message = f"{sharp.name} cannot serve as reference: {problem}; give another sharp frame."
    return ConfigurationError(code, message)


def _shows_something(image: np.ndarray) -> bool:
    """Return whether neighbouring pixels are correlated; those of white noise are not."""
    off = image - image.mean()
    products = np.mean(off[:, 1:] * off[:, :-1]), np.mean(off[1:] * off[:-1])
    return bool(max(products) > _CHANCE * np.mean(off**2) / np.sqrt(off.size))


METHODS = {**BLIND, "trail": estimate_trail}
"""What needs nothing but the image, by name; the last where points of light have drawn lines."""


@dataclass(frozen=True)
class SceneBlurEstimator:
    """Measures the blur of frames without an optical model.

    Attributes
    ----------
    reference : RawFrame, optional
        A sharp frame: of the same telescope for stars, of the same scene for anything else.
    stars : bool, optional
        Whether the frames show a field of stars; by default the reference decides: it does where three
        isolated stars are found in it.
    method : str
        A name in :data:`METHODS`, for scenes without stars and without a reference.
    overrides : mapping
        Metadata from the command line, by field.
    """

    reference: RawFrame | None = None
    stars: bool | None = None
    method: str = "blind"
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            problem = f"There is no blind estimator {self.method!r}; choose from {', '.join(METHODS)}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)

    @property
    def name(self) -> str:
        """Return the name of the estimator."""
        if self.reference is None:
            return "starfield" if self.stars else self.method
        return "reference"

    threads = 1
    """What finds stars and warns of them is not made for more."""
    batch_size = 1
    """A frame may be as large as its camera."""
    plate_scale = None
    """There is no instrument."""

    def for_batch(self, batch: Batch, hdu: int | None) -> Self:
        """Return itself: every frame is compared with the reference alone."""
        return self

    def check(self, paths: Sequence[str | Path], hdu: int | None = None) -> None:
        """Refuse a reference that cannot serve any of some files, before any work is done.

        Raises
        ------
        ConfigurationError
            As :func:`~jitterkit.batch.scene_blur.check_reference` does.
        """
        if self._sharp is not None:
            check_reference(self._sharp, self._starless if self._shows_stars else None, paths, hdu)

    def calibrate(self, raw: RawFrame) -> RawFrame:
        """Return a frame as it is: it may be as large as its camera."""
        return raw

    def complete(self, raw: RawFrame) -> BlurMeasurement:
        """Measure one frame.

        Raises
        ------
        UndeterminedError
            If the image does not determine the blur, or is the reference itself (code ``is_reference``).
        ConfigurationError
            If the reference is of another shape than a scene without stars.
        """
        reference, same = self.reference, raw is self.reference
        if reference is not None and raw.path is not None and reference.path is not None:
            same = (raw.index, raw.hdu) == (reference.index, reference.hdu)
            same = same and raw.path.resolve() == reference.path.resolve()  # whatever the file's name
        if same:
            problem = f"{raw.name} is the reference that the others are compared with."
            raise UndeterminedError(ErrorCode.IS_REFERENCE, problem)
        frame, sharp = self._electrons(raw), self._sharp
        if self._shows_stars:
            found = estimate_field(frame, reference=sharp)
            message = " ".join([found.pattern.sentence, *found.remarks])
            sizes = found.length, found.length_err, found.angle_err
            return BlurMeasurement(frame, found.kernel, frame.plate_scale, found, *sizes, message)
        image, scale = _filled(frame), frame.plate_scale or 1.0
        if sharp is None:
            estimate = METHODS[self.method](image, plate_scale=scale)
        else:
            check_size(sharp, frame.name, frame.shape)
            refuse_other_pixels(sharp, frame)
            mask = sharp.mask | frame.mask
            estimate = estimate_from_reference(_filled(sharp), image, plate_scale=scale, mask=mask)
        return BlurMeasurement.from_estimate(frame, estimate, frame.plate_scale, image)

    def _electrons(self, raw: RawFrame) -> Frame:
        """Return a frame in electrons, by what its header and the command line say."""
        metadata = raw.metadata.apply("command line", **self.overrides)
        return Detector().calibrate(replace(raw, metadata=metadata))

    @cached_property
    def _sharp(self) -> Frame | None:
        """Return the reference, calibrated."""
        return None if self.reference is None else self._electrons(self.reference)

    @cached_property
    def _shows_stars(self) -> bool:
        """Return whether frames show stars, by the user's choice or by the reference."""
        if self.stars is not None or self._sharp is None:
            return bool(self.stars)
        return not self._starless

    @cached_property
    def _starless(self) -> str:
        """Say why the reference shows no stars; nothing if it does."""
        assert self._sharp is not None
        try:
            field_psf(self._sharp)
        except UndeterminedError as error:
            return str(error)
        return ""


def _filled(frame: Frame) -> np.ndarray:
    """Return the image, masked pixels taken from their neighbours."""
    if frame.mask.all():
        raise UndeterminedError(ErrorCode.NO_DATA, f"{frame.name} has no usable pixel.")
    return fill_masked(frame.electrons, ~frame.mask)
