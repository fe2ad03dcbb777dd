"""The truth about simulated frames, as cards of a FITS header or a table of a TIFF's TOML.

Truth begins with ``TRU``; sizes of a jitter that have no keyword of their own (the knots of a path, the
parts of a product) are numbered, ``TRUJ1`` and on, with their names as comments.  The jitter is also
written as ``JITRTYPE`` and ``JITRSIGM``, which stpsf and poppy use, and as ``JITTER_MAJOR`` and
``JITTER_MINOR`` [mas], the names of Roman's schema.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jitterkit.instruments.instrument import Instrument
from jitterkit.loci import Mvn, jitter_cards, locus_name
from jitterkit.shutter import Drifting
from jitterkit.simulate.frames import Simulated

Cards = dict[str, tuple[Any, str]]

_SCENE = {
    "separation": ("TRUSEP", "[arcsec] true separation"),
    "theta": ("TRUTHETA", "[deg] true direction A to B, ccw from +x"),
    "x": ("TRUX", "[arcsec] true place, from the frame centre"),
    "y": ("TRUY", "[arcsec] true place, from the frame centre"),
    "flux": ("TRUFLUX", "[electron] true, star or pair, whole plane"),
    "contrast": ("TRUCONT", "true flux of A over flux of B"),
    "spectral_index_a": ("TRUINDA", "true spectral index of A, or of the star"),
    "spectral_index_b": ("TRUINDB", "true spectral index of B"),
}
_SIZES = {
    "length": ("TRULEN", "[arcsec] full length or peak to peak"),
    "angle": ("TRUANG", "[deg] axis of the jitter, ccw from +x"),
    "sigma_major": ("TRUSMAJ", "[arcsec] 1 sigma, major axis"),
    "sigma_minor": ("TRUSMIN", "[arcsec] 1 sigma, minor axis"),
    "shear": ("TRUSHEAR", "1 - sigma_minor/sigma_major"),
    "sigma_angle": ("TRUSANG", "[deg] major axis of the normal, ccw from +x"),
    "semi_major": ("TRUAMAJ", "[arcsec] semi-axis, major"),
    "semi_minor": ("TRUAMIN", "[arcsec] semi-axis, minor"),
    "amplitude_x": ("TRUAMPX", "[arcsec] amplitude along x, zero to peak"),
    "amplitude_y": ("TRUAMPY", "[arcsec] amplitude along y, zero to peak"),
    "phase": ("TRUPHASE", "[deg] phase of the jitter"),
    "cycles": ("TRUCYCLE", "cycles of the jitter in the exposure"),
    "kurtosis": ("TRUKURT", "excess kurtosis of the jitter"),
    "length1": ("TRULEN1", "[arcsec] peak to peak, first tone"),
    "angle1": ("TRUANG1", "[deg] axis of the first tone, ccw from +x"),
    "length2": ("TRULEN2", "[arcsec] peak to peak, second tone"),
    "angle2": ("TRUANG2", "[deg] axis of the second tone, ccw from +x"),
}
_NUMBERS = {
    "exposure": ("EXPTIME", "[s] exposure"),
    "gain": ("EGAIN", "[electron/adu] gain"),
    "read_noise": ("RDNOISE", "[electron] read noise, 0 if noiseless"),
    "bias": ("BIASLVL", "[adu] bias level"),
    "saturation": ("SATURATE", "[adu] not to be trusted from here on"),
    "plate_scale": ("PIXSCALE", "[arcsec/pixel] plate scale"),
}


def truth_cards(simulated: Simulated, seed: int | None = None) -> Cards:
    """Return what a frame was made of, as cards.

    Parameters
    ----------
    simulated : Simulated
    seed : int, optional
        Of the generator that drew the noise.

    Returns
    -------
    cards : dict
        Keyword to ``(value, comment)``; keywords of at most 8 characters but for Roman's two.
    """
    truth = simulated.truth
    shutter = truth.shutter
    locus = truth.locus if shutter is None else shutter.completed(truth.locus)
    cards: Cards = {}
    for name, value in truth.scene.values.items():
        kind, _, number = (name, "", "") if name in _SCENE else name.partition("_")
        keyword, comment = _SCENE[kind]
        if number:
            keyword, comment = f"{keyword[:6]}{number}", f"{comment}, star {number}"
        cards[keyword] = (value, comment)
    cards["TRULOCUS"] = (locus_name(locus), "true jitter locus")
    sizes = locus.describe()
    others = [size for size in sizes if size not in _SIZES]
    numbered = {size: (f"TRUJ{k}", f"true {size}") for k, size in enumerate(others, start=1)}
    for size, value in sizes.items():
        keyword, comment = {**_SIZES, **numbered}[size]
        cards[keyword] = (float(value), comment)
    moments = [float(value) for value in np.asarray(locus.moments())]
    for axis, value in zip(("XX", "XY", "YY"), moments, strict=True):
        cards[f"TRUS{axis}"] = (value, "[arcsec2] true second moment of the pointing")
    cards |= jitter_cards(moments, normal=isinstance(locus, Mvn))
    for k, (name, value) in enumerate(zip(simulated.aberrations, np.asarray(truth.aberrations), strict=True)):
        keyword = f"TRUN{name[4:]}" if name.startswith("noll") else f"TRUA{k}"
        cards[keyword] = (float(value), f"[nm] true {name}")
    cards["TRUBKG"] = (float(truth.background), "[electron/pixel] true background")
    if shutter is not None:
        cards["TRULINE"] = (float(shutter.line_time), "[s] true, from a row to the one above it")
    if isinstance(shutter, Drifting):
        for axis, value in zip("XY", shutter.velocity, strict=True):
            cards[f"TRUV{axis}"] = (float(value), f"[arcsec/s] true drift of the image along {axis.lower()}")
    if seed is not None:
        cards["TRUSEED"] = (seed, "seed of the noise")
    return cards


def fits_header(
    simulated: Simulated | Sequence[Simulated],
    instrument: Instrument,
    *,
    seed: int | None = None,
    time: str | None = None,
) -> Cards:
    """Return the header of a simulated image or cube, for :func:`jitterkit.frames.write_fits`.

    Parameters
    ----------
    simulated : Simulated or sequence of Simulated
    instrument : Instrument
    seed : int, optional
        Of the noise.
    time : str, optional
        Start of the (first) exposure, ISO 8601, UTC.

    Returns
    -------
    cards : dict
        Keyword to ``(value, comment)``.  A truth that differs between the frames of a cube stands once
        for each, numbered from 0: ``HIERARCH TRUX 0``.
    """
    frames = _several(simulated)
    cards: Cards = {"INSTRUME": (instrument.name, "instrument simulated")}
    if time is not None:
        cards["DATE-OBS"] = (time, "[UTC] start of exposure")
    cards["BUNIT"] = (frames[0].raw.unit, "unit of the pixel values")
    for name, value in _numbers(frames[0]).items():
        keyword, comment = _NUMBERS[name]
        cards[keyword] = (value, comment)
    for keyword, values, comment in _truths(frames, seed):
        several = len(values) > 1
        cards |= {f"{keyword} {k}" if several else keyword: (v, comment) for k, v in enumerate(values)}
    return cards


def tiff_metadata(
    simulated: Simulated | Sequence[Simulated], *, seed: int | None = None, time: str | None = None
) -> dict[str, Any]:
    """Return the metadata of a simulated stack, for :func:`jitterkit.frames.write_tiff`.

    Parameters
    ----------
    simulated, seed, time
        As in :func:`fits_header`.

    Returns
    -------
    metadata : dict
        The truth is in the table ``truth``, which no reader takes for knowledge; what differs between
        the pages is a list.  ``line_time`` is that of the stored rows, from the top down.
    """
    frames = _several(simulated)
    truth = {key: values if len(values) > 1 else values[0] for key, values, _ in _truths(frames, seed)}
    numbers, upwards = _numbers(frames[0]), frames[0].raw.metadata.value("line_time")
    # of the stored rows, of which the first is the top one
    line_time = None if upwards is None else -upwards
    return {**numbers, "line_time": line_time, "unit": frames[0].raw.unit, "time": time, "truth": truth}


def _several(simulated: Simulated | Sequence[Simulated]) -> Sequence[Simulated]:
    return [simulated] if isinstance(simulated, Simulated) else simulated


def _numbers(simulated: Simulated) -> dict[str, float]:
    """Return the numbers of a frame's metadata; electrons need no gain."""
    metadata = simulated.raw.metadata
    names = [
        name for name in _NUMBERS if simulated.raw.unit == "adu" or name not in ("gain", "bias", "saturation")
    ]
    return {name: metadata.value(name) for name in names if metadata.value(name) is not None}


def _truths(frames: Sequence[Simulated], seed: int | None) -> Iterator[tuple[str, list[Any], str]]:
    """Yield each keyword of the truth, its value or, where frames differ, that of each, and its comment."""
    tables = [truth_cards(frame, seed) for frame in frames]
    for keyword, (value, comment) in tables[0].items():
        values = [table[keyword][0] for table in tables]
        yield keyword, [value] if all(one == value for one in values) else values, comment
