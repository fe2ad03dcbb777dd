"""From stacks to all the numbers of a detector.

Reach for :func:`calibrate`; its :class:`Calibration` holds what was measured, and only what was.
:class:`Settings` say how frames are combined and pixels judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jitterkit.calibration import dark_frames
from jitterkit.calibration.checks import check_stacks, split_by_light
from jitterkit.calibration.flat_frames import DEAD, Response, lamp, surface
from jitterkit.calibration.level import Level, measure_level, unlit_level
from jitterkit.calibration.master import CLIP, MEMORY, Master, MeasuredMap, combine
from jitterkit.calibration.stack import Stack
from jitterkit.calibration.transfer import PhotonTransfer, mark_saturated, photon_transfer
from jitterkit.errors import ConfigurationError, ErrorCode, positive

FLAGS = {"hot": 1, "dead": 2, "noisy": 4, "blank": 8}
"""Bits of the bad-pixel map."""


@dataclass(frozen=True)
class Settings:
    """Rules by which frames are combined and pixels judged.

    Parameters
    ----------
    clip : float
        Noises of a frame beyond which a value is left out, 3 at least.
    hot : float
        Robust standard deviations over the median dark current from which a pixel is hot.
    dead : float
        Share of the response around it below which a pixel is dead.
    smooth : bool
        Whether the smooth part of the flats is divided out, as the lamp's.
    memory : float
        Bytes that the pixels read at a time may take.

    Raises
    ------
    ConfigurationError
        If one is out of range.
    """

    clip: float = CLIP
    hot: float = dark_frames.HOT
    dead: float = DEAD
    smooth: bool = False
    memory: float = MEMORY

    def __post_init__(self) -> None:
        for name, low, high in (("clip", 3.0, np.inf), ("hot", 3.0, np.inf), ("dead", 0.0, 1.0)):
            value = getattr(self, name)
            if not low <= value <= high:
                limits = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more"
                problem = f"{name} = {value:g} is out of range; give {limits}."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A detector as calibration frames show it; None where no frames were given.

    Parameters
    ----------
    shape : (int, int)
    gain, gain_error : float
        e-/ADU, as used for the others.
    bias, read_noise, dark_current, flat : MeasuredMap, optional
        ADU, e-, e-/s, relative.
    local : MeasuredMap, optional
        The flat over the smooth surface through it.
    transfer : PhotonTransfer, optional
    bad : (ny, nx) uint8 array
        Bits of :data:`FLAGS`.
    hot_limit : float, optional
        Dark current from which a pixel was called hot [e-/s].
    settings : Settings
    rejected : mapping
        Values left out as outliers, and how many there were, by kind of frame.
    gradient : float
        Largest over smallest value of the smooth surface through the flat, less one.
    """

    shape: tuple[int, int]
    gain: float
    gain_error: float
    bad: np.ndarray
    settings: Settings
    bias: MeasuredMap | None = None
    read_noise: MeasuredMap | None = None
    dark_current: MeasuredMap | None = None
    flat: MeasuredMap | None = None
    local: MeasuredMap | None = None
    transfer: PhotonTransfer | None = None
    hot_limit: float | None = None
    gradient: float = 0.0
    rejected: dict[str, tuple[int, int]] = field(default_factory=dict)

    @property
    def maps(self) -> tuple[MeasuredMap, ...]:
        """Return the maps that were measured."""
        found = (self.bias, self.read_noise, self.dark_current, self.flat)
        return tuple(each for each in found if each is not None)

    @property
    def prnu(self) -> tuple[float, float]:
        """Spread of the pixels' response and its standard error, relative; NaN without flats."""
        if self.local is None:
            return float("nan"), float("nan")
        pixels, spread = float((self.bad == 0).sum()), self.local.true_spread
        of_square = self.local.spread**2 * (2 / pixels) ** 0.5
        return spread, min(of_square / (2 * spread), of_square**0.5) if spread else of_square**0.5

    def count(self, flag: str) -> int:
        """Return how many pixels are bad in a way of :data:`FLAGS`."""
        return int(np.count_nonzero(self.bad & FLAGS[flag]))


def calibrate(
    bias: Stack | None = None,
    darks: Sequence[Stack] = (),
    flats: Sequence[Stack] = (),
    *,
    bias_level: float | None = None,
    gain: float | None = None,
    settings: Settings | None = None,
) -> Calibration:
    """Measure a detector.

    Parameters
    ----------
    bias : Stack, optional
        Frames without exposure.
    darks, flats : sequence of Stack
        Frames without light and evenly lit, a stack an exposure time.
    bias_level : float, optional
        ADU, where there are no bias frames.
    gain : float, optional
        e-/ADU, where there are no flats that tell it.
    settings : Settings, optional

    Returns
    -------
    calibration : Calibration

    Raises
    ------
    ConfigurationError
        If frames do not belong together, the gain is not positive, or something is missing without which the
        others say nothing.
    """
    if gain is not None:
        positive("gain", gain, "e-/ADU")
    chosen = settings or Settings()
    check_stacks(bias, darks, flats)
    shape = next(stack.shape for stack in (bias, *darks, *flats) if stack is not None)
    work = _Work(chosen, shape, bias, bias_level)
    levels, response = work.flat(flats, work.dark(darks))
    transfer = photon_transfer(levels) if len(flats) else None
    if transfer is None and gain is None:
        problem = "the gain is unknown, so that nothing can be said in electrons; give --gain, or flats."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    known = (gain or 0.0, 0.0) if transfer is None else (transfer.gain, transfer.gain_error)
    return work.result(known, transfer, response)


class _Work:
    """State that is handed from one kind of frame to the next."""

    def __init__(self, settings: Settings, shape: tuple[int, int], bias: Stack | None, level: float | None):
        self.settings, self.shape = settings, shape
        self.rejected: dict[str, tuple[int, int]] = {}
        self.master = None if bias is None else self.combined(bias)
        self.level = level if self.master is None else float(np.median(self.master.mean))
        self.slope: dark_frames.DarkSlope | None = None
        self.hot_limit: float | None = None
        self.bad = np.zeros(shape, np.uint8)
        if self.master is not None:
            self.spoil("blank", self.master.unusable)
            noisy = self.master.variance > dark_frames.NOISY**2 * self.master.usual
            self.spoil("noisy", noisy & ~self.master.unusable)

    def combined(self, stack: Stack, scales: np.ndarray | None = None, pedestal: float = 0.0) -> Master:
        chosen = self.settings
        master = combine(stack, clip=chosen.clip, memory=chosen.memory, scales=scales, pedestal=pedestal)
        before = self.rejected.get(stack.kind, (0, 0))
        self.rejected[stack.kind] = before[0] + master.rejected, before[1] + len(stack) * master.mean.size
        return master

    def spoil(self, flag: str, where: np.ndarray) -> None:
        self.bad[where] |= FLAGS[flag]

    def dark(self, stacks: Sequence[Stack]) -> np.ndarray | float:
        """Dark current of each pixel [ADU/s]; zero where nobody measured it."""
        if not stacks:
            return 0.0
        level = self.level if len(stacks) == 1 else None
        self.slope = dark_frames.DarkSlope(level if self.master is None else self.master)
        for stack in stacks:
            self.spoil("blank", stack.unusable)
            self.slope.add(self.combined(stack))
        rate = self.slope.rate()[0]
        usable = (self.bad & FLAGS["blank"]) == 0
        hot, self.hot_limit = dark_frames.hot_pixels(rate, usable, self.settings.hot)
        self.spoil("hot", hot)
        return rate

    def flat(self, stacks: Sequence[Stack], rate: np.ndarray | float) -> tuple[list[Level], Response | None]:
        """Return the levels of light, and the response they sum up to."""
        if not stacks:
            return [], None
        if self.level is None:
            problem = "flats cannot be used without the bias beneath them"
            remedy = "give --bias, or its level by --bias-level"
            raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; {remedy}.")
        zero: Master | float = self.level if self.master is None else self.master
        response = Response(zero, rate)
        levels: list[Level] = []
        if self.master is not None:
            levels.append(unlit_level(self.master, self.bad == 0))
        split = [split_by_light(stack, self.level) for stack in stacks]
        for stack in sorted((s for group in split for s in group), key=lambda s: s.level):
            self.spoil("blank", stack.unusable)
            shots, samples = stack.shots, min(stack.shape[0] * stack.shape[1], 65536)
            levels_of_lamp = np.array([shot.level - self.level for shot in shots])
            scales = lamp(levels_of_lamp, np.array([shot.scatter for shot in shots]) / samples**0.5)
            master = self.combined(stack, scales, self.level)
            piled = float(np.mean([shot.saturated for shot in shots])) >= 0.5
            level = measure_level(master, zero, self.bad == 0, scales=scales, saturated=piled)
            levels = mark_saturated([*levels, level])
            if not levels[-1].saturated:
                response.add(master)
        return levels, response

    def result(
        self, gain: tuple[float, float], transfer: PhotonTransfer | None, response: Response | None
    ) -> Calibration:
        """Return the calibration, all in electrons."""
        if response is not None:
            usable = (self.bad & (FLAGS["blank"] | FLAGS["hot"])) == 0
            light = self.settings.dead * surface(response.sums, usable)
            self.spoil("dead", usable & (response.sums < light))
        good = self.bad == 0
        if not good.any():
            problem = f"none of the {good.size} pixels is good; check which frames are which."
            raise ConfigurationError(ErrorCode.NO_DATA, problem)
        flat = local = None
        gradient = 0.0
        if response is not None:
            bend = 1.0 if transfer is None else transfer.bend
            flat, local = response.map(good, smooth=self.settings.smooth, bend=bend)
            lit = surface(response.sums, good)
            gradient = float(lit.max() / lit.min() - 1)
        master = self.master
        return Calibration(
            shape=self.shape,
            gain=gain[0],
            gain_error=gain[1],
            bad=self.bad,
            settings=self.settings,
            bias=None if master is None else dark_frames.bias_map(master, good),
            read_noise=None if master is None else dark_frames.read_noise_map(master, good, *gain),
            dark_current=None if self.slope is None else self.slope.map(good, *gain),
            flat=flat,
            local=local,
            transfer=transfer,
            hot_limit=None if self.hot_limit is None else self.hot_limit * gain[0],
            gradient=gradient,
            rejected=self.rejected,
        )
