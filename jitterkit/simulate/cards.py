"""The truth about simulated frames, as cards of a FITS header or a table of a TIFF's TOML.

Truth begins with ``TRU``.  The jitter is also written as ``JITRTYPE`` and ``JITRSIGM``, which stpsf and
poppy use, and as ``JITTER_MAJOR`` and ``JITTER_MINOR`` [mas], the names of Roman's schema.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jitterkit.instruments.instrument import Instrument
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.scene import Binary
from jitterkit.simulate.frames import Simulated

__all__ = ["fits_header", "tiff_metadata", "truth_cards"]

Cards = dict[str, tuple[Any, str]]

_SCENE = {
    "separation": ("TRUSEP", "[arcsec] true separation"),
    "theta": ("TRUTHETA", "[deg] true direction A to B, ccw from +x"),
    "x": ("TRUX", "[arcsec] true midpoint, from the frame centre"),
    "y": ("TRUY", "[arcsec] true midpoint, from the frame centre"),
    "flux": ("TRUFLUX", "[electron] true, both stars, whole plane"),
    "contrast": ("TRUCONT", "true flux of A over flux of B"),
}
_SIZES = {
    "length": ("TRULEN", "[arcsec] full length or peak to peak"),
    "angle": ("TRUANG", "[deg] axis of the jitter, ccw from +x"),
    "sigma_major": ("TRUSMAJ", "[arcsec] 1 sigma, major axis"),
    "sigma_minor": ("TRUSMIN", "[arcsec] 1 sigma, minor axis"),
    "shear": ("TRUSHEAR", "1 - sigma_minor/sigma_major"),
}
_NUMBERS = {
    "exposure": ("EXPTIME", "[s] exposure"),
    "gain": ("EGAIN", "[electron/adu] gain"),
    "read_noise": ("RDNOISE", "[electron] read noise"),
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
    cards = {**_scene_cards(truth.binary), **_jitter_cards(truth.locus)}
    for k, (name, value) in enumerate(zip(simulated.aberrations, np.asarray(truth.aberrations), strict=True)):
        keyword = f"TRUN{name[4:]}" if name.startswith("noll") else f"TRUA{k}"
        cards[keyword] = (float(value), f"[nm] true {name}")
    cards["TRUBKG"] = (float(truth.background), "[electron/pixel] true background")
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
    return {**cards, **_merged([truth_cards(frame, seed) for frame in frames])}


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
        the pages is a list.
    """
    frames = _several(simulated)
    tables = [truth_cards(frame, seed) for frame in frames]
    truth = {}
    for keyword in tables[0]:
        values = [table[keyword][0] for table in tables]
        truth[keyword] = values[0] if _same(values) else values
    return {**_numbers(frames[0]), "unit": frames[0].raw.unit, "time": time, "truth": truth}


def _several(simulated: Simulated | Sequence[Simulated]) -> Sequence[Simulated]:
    return [simulated] if isinstance(simulated, Simulated) else simulated


def _numbers(simulated: Simulated) -> dict[str, float]:
    """What a frame's metadata know; electrons need no gain."""
    metadata = simulated.raw.metadata
    names = [
        name for name in _NUMBERS if simulated.raw.unit == "adu" or name not in ("gain", "bias", "saturation")
    ]
    return {name: metadata.value(name) for name in names if metadata.value(name) is not None}


def _scene_cards(scene: Binary) -> Cards:
    return {keyword: (float(getattr(scene, name)), text) for name, (keyword, text) in _SCENE.items()}


def _jitter_cards(locus: Locus) -> Cards:
    name = type(locus).__name__.lower()
    cards: Cards = {"TRULOCUS": (name, "true jitter locus")}
    for size, value in locus.describe().items():
        keyword, comment = _SIZES.get(size, (f"TRU{size[:5].upper()}", f"true {size}"))
        cards[keyword] = (float(value), comment)
    moments = [float(value) for value in np.asarray(locus.moments())]
    for axis, value in zip(("XX", "XY", "YY"), moments, strict=True):
        cards[f"TRUS{axis}"] = (value, "[arcsec2] true second moment of the pointing")
    major, minor, _ = principal_axes(moments)
    cards["JITRTYPE"] = ("Gaussian convolution" if name == "mvn" else name, "type of jitter")
    cards["JITRSIGM"] = (math.hypot(major, minor) / math.sqrt(2), "[arcsec] rms of the jitter per axis")
    cards["JITTER_MAJOR"] = (1e3 * major, "[mas] 1 sigma, major axis")
    cards["JITTER_MINOR"] = (1e3 * minor, "[mas] 1 sigma, minor axis")
    return cards


def _merged(tables: list[Mapping[str, tuple[Any, str]]]) -> Cards:
    cards: Cards = {}
    for keyword, (value, comment) in tables[0].items():
        values = [table[keyword][0] for table in tables]
        if _same(values):
            cards[keyword] = (value, comment)
        else:
            cards.update({f"{keyword} {index}": (v, comment) for index, v in enumerate(values)})
    return cards


def _same(values: list[Any]) -> bool:
    return all(value == values[0] for value in values)
