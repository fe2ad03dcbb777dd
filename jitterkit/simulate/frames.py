"""Frames whose truth is known: the forward model, then the detector.

:func:`simulate_frame` makes one frame, :func:`simulate_sequence` many with little more work than the
first: the optics are expanded anew only where the aberrations change, and nothing is compiled twice.
Both use the model that a fit uses, expanded exactly at the aberrations; what they cannot show is
where that model differs from nature.  :mod:`jitterkit.simulate.cards` writes the truth into a header.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.detectors.detector import ASSUMED
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import Metadata
from jitterkit.instruments.instrument import Instrument
from jitterkit.loci.base import Locus
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary
from jitterkit.simulate.checks import check_reach, check_scene

__all__ = ["Simulated", "simulate_frame", "simulate_sequence"]

_SOURCE = "argument of the simulation"


@dataclass(frozen=True, eq=False)
class Simulated:
    """A frame and what it was made of.

    Attributes
    ----------
    raw : RawFrame
        In ADU as the instrument's detector reads it, or in electrons if there was none.
    truth : Parameters
        Scene, jitter, aberrations [nm] and background [e-/pixel].
    expected : (ny, nx) array
        Electrons before any noise.
    aberrations : tuple of str
        Names of the aberrations.
    """

    raw: RawFrame
    truth: Parameters
    expected: np.ndarray
    aberrations: tuple[str, ...]


def simulate_frame(
    instrument: Instrument,
    scene: Binary,
    locus: Locus,
    *,
    aberrations=None,
    background: float = 0.0,
    rng: np.random.Generator | None = None,
    detector: bool = True,
    pad: int | None = None,
    otf: OTF | None = None,
) -> Simulated:
    """Simulate one frame.

    Parameters
    ----------
    instrument : Instrument
    scene : Binary
    locus : Locus
    aberrations : (k,) array, optional
        nm, in the order of ``instrument.aberrations``; none if omitted.
    background : float
        Electrons per pixel.
    rng : numpy.random.Generator, optional
        Draws photon and read noise; without it the frame has none.
    detector : bool
        Whether to read the image out; if not, the frame is in electrons, with photon noise at most.
    pad : int, optional
        Padding of the model, pixels on each side.
    otf : OTF, optional
        The instrument's optics at these aberrations, where they are at hand.

    Returns
    -------
    simulated : Simulated
        The same bits for the same generator state, on one machine.

    Raises
    ------
    ConfigurationError
        If the aberrations do not fit the instrument, a value is impossible, or light would leave the
        padded grid and come back on its other side.
    """
    check_scene(scene, locus, background)
    state = np.zeros(len(instrument.aberrations)) if aberrations is None else np.asarray(aberrations, float)
    if otf is None:
        otf = instrument.optics(state, pad=pad, derivatives=False)
    check_reach(scene, locus, otf)
    truth = Parameters(scene, locus, state, background)
    # an OTF without derivatives is exact at its own state, whatever the parameters say
    expected = np.asarray(expected_image(truth, otf), dtype=float)
    raw = _read_out(instrument, expected, rng) if detector else _counted(instrument, expected, rng)
    return Simulated(raw, truth, expected, instrument.aberrations)


def simulate_sequence(
    instrument: Instrument,
    scene: Binary,
    locus: Locus | Sequence[Locus],
    frames: int,
    *,
    theta=None,
    x=None,
    y=None,
    aberrations=None,
    background: float = 0.0,
    rng: np.random.Generator | None = None,
    detector: bool = True,
    pad: int | None = None,
) -> Iterator[Simulated]:
    """Simulate frames one after the other.

    Parameters
    ----------
    instrument, scene, background, rng, detector, pad
        As in :func:`simulate_frame`.
    locus : Locus or sequence of Locus
        Common to all, or frame by frame; of one kind and shape nothing is compiled twice.
    frames : int
        How many.
    theta, x, y : (frames,) array, optional
        In place of the scene's, frame by frame: degrees, arcsec, arcsec.
    aberrations : (k,) or (frames, k) array, optional
        nm; common to all, or frame by frame.

    Yields
    ------
    simulated : Simulated

    Raises
    ------
    ValueError
        If an array has another length; the message gives it.
    """
    changes = {name: values for name, values in (("theta", theta), ("x", x), ("y", y)) if values is not None}
    for name, values in changes.items():
        if np.shape(values) != (frames,):
            raise ValueError(
                f"{name} has shape {np.shape(values)}; give one value for each of {frames} frames."
            )
    loci = [locus] * frames if isinstance(locus, Locus) else locus
    if len(loci) != frames:
        raise ValueError(f"locus has {len(loci)} loci; give one, or one for each of {frames} frames.")
    states = _states(instrument, aberrations, frames)
    otf = None
    for index in range(frames):
        if otf is None or not np.array_equal(states[index], states[index - 1]):
            otf = instrument.optics(states[index], pad=pad, derivatives=False)
        moved = _moved(scene, {name: values[index] for name, values in changes.items()})
        simulated = simulate_frame(
            instrument,
            moved,
            loci[index],
            aberrations=states[index],
            background=background,
            rng=rng,
            detector=detector,
            otf=otf,
        )
        yield replace(simulated, raw=replace(simulated.raw, index=index, several=frames > 1))


def _states(instrument: Instrument, aberrations, frames: int) -> np.ndarray:
    """Aberrations (frames, k)."""
    modes = len(instrument.aberrations)
    given = np.zeros(modes) if aberrations is None else np.asarray(aberrations, float)
    if given.shape not in ((modes,), (frames, modes)):
        raise ValueError(
            f"aberrations has shape {given.shape}; give ({modes},) or ({frames}, {modes}), in nm."
        )
    return np.broadcast_to(given, (frames, modes))


def _moved(scene: Binary, changes: dict[str, float]) -> Binary:
    names = ("separation", "theta", "x", "y", "flux", "contrast")
    return Binary(**{name: changes.get(name, getattr(scene, name)) for name in names})


def _read_out(instrument: Instrument, expected: np.ndarray, rng) -> RawFrame:
    detector = instrument.detector
    numbers = {name: getattr(detector, name) for name in ASSUMED}
    metadata = _common(instrument).override(_SOURCE, unit="adu", **ASSUMED).override(_SOURCE, **numbers)
    return RawFrame(detector.expose(expected, rng), metadata=detector.inform(metadata))


def _counted(instrument: Instrument, expected: np.ndarray, rng) -> RawFrame:
    electrons = expected if rng is None else rng.poisson(np.maximum(expected, 0.0)).astype(float)
    return RawFrame(
        electrons, metadata=_common(instrument).override(_SOURCE, unit="electron", read_noise=0.0)
    )


def _common(instrument: Instrument) -> Metadata:
    return Metadata().override(_SOURCE, exposure=instrument.exposure, plate_scale=instrument.plate_scale)
