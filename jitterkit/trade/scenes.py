"""Frames of one scene by which settings are judged: exact ones without noise, and noisy ones to be timed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import RawFrame
from jitterkit.instruments import Instrument
from jitterkit.known_light import KnownLight
from jitterkit.loci import Locus
from jitterkit.optics import Optics
from jitterkit.scene import Binary
from jitterkit.simulate import check_reach
from jitterkit.trade.settings import Settings

_WIDEST, _WAVELENGTHS = (192, 128, 96, 64, 32, 16), 24
"""Padding, as far as the samples of a pupil carry it, and wavelengths, at which an image is right: to a
chi-squared of 1e-3 of a frame of TOLIMAN."""

_STATE, _WANDER = 3.0, 0.5
"""nm rms of each aberration: where the telescope stands, if it is not better known, and how far a frame is
from there."""

_OFF = 2.0
"""Pixels, to each side, that a pair may be from the middle of its frame."""


@dataclass(frozen=True)
class TradeScene:
    """Frames of one pair, one jitter and one telescope as they follow each other, and some that are turned.

    Attributes
    ----------
    truths : tuple of Parameters
        First of frames that share the direction of the pair, then of others, each turned its own way.
    images : tuple of (ny, nx) array
        Expected electrons, exact.
    plain : tuple of RawFrame
        Read out by the detector without noise.
    noisy : tuple of RawFrame
        Those that share their direction, with the noise of photons and detector.
    lead : RawFrame
        One more of them, which shows the optics to the others.
    """

    truths: tuple[Parameters, ...]
    images: tuple[np.ndarray, ...]
    plain: tuple[RawFrame, ...]
    noisy: tuple[RawFrame, ...]
    reference: RawFrame

    @classmethod
    def of(
        cls, instrument: Instrument, pair: Binary, locus: Locus, frames: int, rng: np.random.Generator
    ) -> TradeScene:
        """Draw direction, place and aberrations of some frames, and of as many turned ones.

        Parameters
        ----------
        instrument : Instrument
        pair : Binary
            Its place and direction are drawn.
        locus : Locus
        frames : int
            That share their direction.
        rng : numpy.random.Generator

        Raises
        ------
        ConfigurationError
            If light would leave the modelled field, or the locus is not computed so far.

        Notes
        -----
        *Fails when* a pupil is sampled too coarsely for more padding than its instrument has: what that
        leaves out is then not seen.
        """
        system = truest(instrument)
        known = instrument.aberration_sigma
        state = rng.normal(0, _STATE if known is None else min(_STATE, known), len(instrument.aberrations))
        truths, images, known_light = [], [], KnownLight.of(instrument)
        for theta in [rng.uniform(0, 360)] * (frames + 1) + list(rng.uniform(0, 360, frames)):
            x, y = rng.uniform(-_OFF, _OFF, 2) * instrument.plate_scale
            start = Binary(pair.separation, theta, x, y, pair.flux, pair.contrast)
            here = state + rng.normal(0, _WANDER, len(state))
            otf = system.otf(here, derivatives=False)
            truths.append(Parameters(start, locus, here).completed(otf))
            check_reach(start, locus, otf)
            image = np.asarray(expected_image(truths[-1], otf), float)
            images.append(image if known_light is None else image + known_light.image(truths[-1], otf))

        def read(images: list[np.ndarray], rng: np.random.Generator | None) -> tuple[RawFrame, ...]:
            detector, exposure = instrument.detector, instrument.exposure
            exposed = (detector.expose(image, rng, exposure=exposure) for image in images)
            return tuple(RawFrame.from_array(one, exposure=exposure) for one in exposed)

        reference, *noisy = read(images[: frames + 1], rng)
        return cls(tuple(truths[1:]), tuple(images[1:]), read(images[1:], None), tuple(noisy), reference)


def truest(
    instrument: Instrument, shape: tuple[int, int] | None = None, plate_scale: float | None = None
) -> Optics:
    """Return the most exact optics that the pupil of an instrument carries, on a frame's grid if not its own.

    Raises
    ------
    ConfigurationError
        If the grid does not suit the pupil.
    """
    for pad in _WIDEST:
        try:
            settings = Settings(pad=pad, samples=_WAVELENGTHS).at_least(instrument)
            return settings.instrument(instrument).system(shape=shape, plate_scale=plate_scale)
        except ConfigurationError as error:
            problem = error
    raise problem
