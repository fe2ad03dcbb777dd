"""Frames whose truth is known: the forward model, then the detector.

:func:`simulate_frame` makes one frame, :func:`simulate_sequence` many with little more work than the
first: the optics are expanded again only where the aberrations change, and nothing is compiled twice.
Both use the model that a fit uses, expanded exactly at the aberrations; what they cannot show is
where that model differs from nature.  :mod:`jitterkit.simulate.cards` writes the truth into a header.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.detectors.knowledge import ASSUMED
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Metadata, RawFrame
from jitterkit.instruments.instrument import Instrument
from jitterkit.known_light import KnownLight
from jitterkit.loci.base import Locus
from jitterkit.optics.otf import OTF
from jitterkit.scene import Scene
from jitterkit.shutter import Drifting, Shutter, with_enough_nodes
from jitterkit.simulate.checks import check_reach, check_scene

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
    scene: Scene,
    locus: Locus,
    *,
    aberrations=None,
    background: float = 0.0,
    velocity=None,
    shutter: Shutter | None = None,
    row_order: int = 1,
    rng: np.random.Generator | None = None,
    detector: bool = True,
    pad: int | None = None,
    otf: OTF | None = None,
) -> Simulated:
    """Simulate one frame.

    Parameters
    ----------
    instrument : Instrument
    scene : Scene
        Without spectral indices, its stars have those that the instrument says.
    locus : Locus
    aberrations : (k,) array, optional
        nm, in the order of ``instrument.aberrations``; none if omitted.
    background : float
        Electrons per pixel.
    velocity : (2,) array, optional
        At which the image drifts along x and y, arcsec/s: where the detector has a ``line_time`` its rows are
        exposed one after the other.  The streak of the drift is the locus's.
    shutter : Shutter, optional
        In place of a velocity, whatever the detector: a measured motion under
        :class:`jitterkit.shutter.Following`, say.  It gets as many nodes as it needs.
    row_order : {1, -1}
        Whether the rows will be stored in their order, as FITS does, or turned over, as TIFF does: the
        detector's ``line_time`` is that of the stored rows.
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
    if velocity is not None and shutter is not None:
        problem = "Give a velocity or a shutter, not both: a shutter holds its own motion."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)
    check_scene(scene, locus, background)
    state = np.zeros(len(instrument.aberrations)) if aberrations is None else np.asarray(aberrations, float)
    if otf is None:
        otf = instrument.optics(state, pad=pad, derivatives=False)
    if shutter is None:
        shutter = drifting_shutter(instrument.detector, velocity, row_order)
    if shutter is not None:
        shutter = with_enough_nodes(shutter, otf.grid.shape[0], otf.grid.nyquist)
    check_reach(scene, locus if shutter is None else shutter.completed(locus), otf)
    truth = Parameters(otf.with_colours(scene), locus, state, background, shutter=shutter)
    # an OTF without derivatives is exact at its own state, whatever the parameters say
    expected = np.asarray(expected_image(truth, otf), dtype=float)
    if (known_light := KnownLight.of(instrument)) is not None:
        expected = expected + known_light.image(truth, otf)
    camera = instrument.detector
    line_time = line_time_of(camera, row_order) if shutter is None else float(shutter.line_time)
    numbers = {"exposure": instrument.exposure, "plate_scale": instrument.plate_scale, "line_time": line_time}
    known = Metadata(row_order=row_order).override(_SOURCE, **numbers)
    if detector:
        nominal = {name: camera.nominal(name) for name in ASSUMED}
        known = known.override(_SOURCE, unit="adu", **ASSUMED).override(_SOURCE, **nominal)
        readings = camera.expose(expected, rng, exposure=instrument.exposure)
        raw = RawFrame(readings, metadata=camera.inform(known))
    else:
        electrons = expected if rng is None else rng.poisson(np.maximum(expected, 0.0)).astype(float)
        raw = RawFrame(electrons, metadata=known.override(_SOURCE, unit="electron", read_noise=0.0))
    return Simulated(raw, truth, expected, instrument.aberrations)


def simulate_sequence(
    instrument: Instrument,
    scene: Scene,
    locus: Locus | Sequence[Locus],
    frames: int,
    *,
    separation=None,
    theta=None,
    x=None,
    y=None,
    flux=None,
    aberrations=None,
    background: float = 0.0,
    velocity=None,
    shutter: Shutter | Sequence[Shutter] | None = None,
    row_order: int = 1,
    rng: np.random.Generator | None = None,
    detector: bool = True,
    pad: int | None = None,
) -> Iterator[Simulated]:
    """Simulate frames one after the other.

    Parameters
    ----------
    instrument, scene, background, row_order, rng, detector, pad
        As in :func:`simulate_frame`.
    locus : Locus or sequence of Locus
        Common to all, or frame by frame; of one kind and shape nothing is compiled twice.
    frames : int
        How many.
    separation, theta, x, y, flux : (frames,) array, optional
        In place of the scene's, frame by frame: arcsec, degrees, arcsec, arcsec, electrons.  One star has no
        separation and no theta.
    aberrations : (k,) or (frames, k) array, optional
        nm; common to all, or frame by frame.
    velocity : (2,) or (frames, 2) array, optional
        arcsec/s; common to all, or frame by frame.  It rolls the rows and no more: where the frames of a
        drift stand is up to ``x`` and ``y``, its streak to the locus.
    shutter : Shutter or sequence of Shutter, optional
        Likewise.

    Yields
    ------
    simulated : Simulated

    Raises
    ------
    ConfigurationError
        If an array has another length; the message gives it.
    """
    changes = {"separation": separation, "theta": theta, "x": x, "y": y, "flux": flux}
    changes = {name: values for name, values in changes.items() if values is not None}
    for name in set(changes) - set(scene.names):
        problem = f"A {scene.name} has no {name}; there are {', '.join(scene.names)}."
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
    for name, values in changes.items():
        if np.shape(values) != (frames,):
            problem = f"{name} has shape {np.shape(values)}; give one value for each of {frames} frames."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    loci = [locus] * frames if isinstance(locus, Locus) else locus
    if len(loci) != frames:
        problem = f"locus has {len(loci)} loci; give one, or one for each of {frames} frames."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    shutters = shutter if isinstance(shutter, Sequence) else [shutter] * frames
    if len(shutters) != frames:
        problem = f"shutter has {len(shutters)}; give one, or one for each of {frames} frames."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    velocities = [None] * frames if velocity is None else _each("velocity", velocity, 2, frames, "arcsec/s")
    states = _each("aberrations", aberrations, len(instrument.aberrations), frames, "nm")
    otf = None
    for index in range(frames):
        if otf is None or not np.array_equal(states[index], states[index - 1]):
            otf = instrument.optics(states[index], pad=pad, derivatives=False)
        values = scene.values | {name: column[index] for name, column in changes.items()}
        simulated = simulate_frame(
            instrument,
            scene.at(list(values.values())),
            loci[index],
            aberrations=states[index],
            background=background,
            velocity=velocities[index],
            shutter=shutters[index],
            row_order=row_order,
            rng=rng,
            detector=detector,
            otf=otf,
        )
        yield replace(simulated, raw=replace(simulated.raw, index=index, several=frames > 1))


def _each(name: str, values, width: int, frames: int, unit: str) -> np.ndarray:
    """Return the values (frames, width), zero if not given, from one row for all frames or one for each."""
    given = np.zeros(width) if values is None else np.asarray(values, float)
    if given.shape not in ((width,), (frames, width)):
        problem = f"{name} has shape {given.shape}; give ({width},) or ({frames}, {width}), in {unit}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    return np.broadcast_to(given, (frames, width))


def line_time_of(detector: Detector, row_order: int) -> float | None:
    """Time [s] from a row's exposure to that of the row above it in memory; None where nobody says."""
    return None if detector.line_time is None else detector.line_time * row_order


def drifting_shutter(detector: Detector, velocity, row_order: int = 1) -> Drifting | None:
    """Return the shutter of a detector under a uniform drift.

    Parameters
    ----------
    detector : Detector
    velocity : (2,) array or None
        Of the image along x and y, arcsec/s.
    row_order : {1, -1}
        Whether the rows of the file will be those in memory, or turned over, as a TIFF's are.

    Returns
    -------
    shutter : Drifting or None
        None, which is a global shutter, where the detector has one or nothing drifts.

    Raises
    ------
    ConfigurationError
        If the velocity is not two finite numbers.
    """
    if velocity is None:
        return None
    if (shape := np.shape(velocity)) != (2,) or not np.all(np.isfinite(velocity)):
        code = ErrorCode.OUT_OF_RANGE if shape == (2,) else ErrorCode.WRONG_SHAPE
        raise ConfigurationError(code, f"velocity = {velocity} is not a drift; give (vx, vy) in arcsec/s.")
    line_time = line_time_of(detector, row_order)
    return Drifting(line_time, velocity) if line_time and np.any(velocity) else None
