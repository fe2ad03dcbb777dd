"""Instruments and detectors as a table: every number, and who says so."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.detectors.characteristics import NUMBERS
from jitterkit.frames.metadata import QUANTITIES
from jitterkit.instruments.background_stars import BackgroundStars
from jitterkit.instruments.instrument import Instrument
from jitterkit.instruments.sky import SKY_KEYS

Row = tuple[str, str, str, str]

_UNITS = {
    "shape": "pixel",
    "flux": "photons per frame",
    "aberration_sigma": "nm",
    "bits": "bit",
    "nonlinearity": "1/e-, 1/e-², ...",
}
_NO_MODEL = {
    "flat",
    "nonlinearity",
    "coupling",
    "brighter_fatter",
    "diffusion",
    "pixel_shift_x",
    "pixel_shift_y",
    "cosmic_rays",
    "dark_current",
    "bad_pixels",
}


def describe_instrument(instrument: Instrument) -> list[Row]:
    """Return ``(name, value, unit, source)`` of an instrument and its detector, as text."""
    names = ("plate_scale", "shape", "exposure", "flux")
    rows = [_row(name, getattr(instrument, name), instrument.source(name)) for name in names]
    band = instrument.spectrum
    if band is not None:
        text = f"{min(band.wavelengths):g} to {max(band.wavelengths):g}"
        rows.append(("spectrum", text, "nm", instrument.source("spectrum")))
    if band is not None and band.has_colour and instrument.colours is not None:
        known, source = instrument.colours, instrument.source("spectrum")
        rows.append(("spectral indices", _text("indices", known.indices), "", source))
        rows.append(("their prior error", f"{known.sigma:g}", "", source))
        rows.append(("relative error of wavelengths", f"{known.wavelength_err:g}", "", source))
        if known.temperature is not None:
            rows.append(("mean temperature of the stars", f"{known.temperature:g}", "K", source))
    for name in ("plate_scale_err", "aberration_sigma"):
        if (value := getattr(instrument, name)) is not None:
            rows.append(_row(name, value, instrument.source(name)))
    fitted = {
        "plate_scale_free": ("yes",) * instrument.plate_scale_free,
        "transmission": instrument.transmission,
        "modes_of_b": instrument.modes_of_b,
    }
    rows += [(key, ", ".join(names), "", instrument.source(key)) for key, names in fitted.items() if names]
    for name, unit in SKY_KEYS.items():
        if (value := getattr(instrument.sky, name, None)) is not None:
            if isinstance(value, BackgroundStars):
                turned = "" if value.pair_angle is None else f", pair_angle {value.pair_angle:g} deg"
                turned += ", mirrored" * value.mirrored
                value = f"{len(value.separation)} in a catalogue{turned}"
            text = value if isinstance(value, str) else _text(name, value)
            rows.append((name, text, unit, instrument.source("sky")))
    return rows + describe_detector(instrument.detector)


def describe_detector(detector: Detector) -> list[Row]:
    """Return ``(name, value, unit, source)`` of a detector, as text; a map by its size and median."""
    names = [f.name for f in fields(Detector) if f.name not in ("sources", "map_orders", "map_windows")]
    return [_row(name, getattr(detector, name), detector.source(name)) for name in names]


def _row(name: str, value: Any, source: str) -> Row:
    quantity = NUMBERS.get(name) or QUANTITIES.get(name)
    unit = _UNITS.get(name, "" if quantity is None else quantity.unit)
    if value is None:
        return (name, "not modelled" if name in _NO_MODEL else "unknown", unit, "")
    return (name, _text(name, value), unit, source)


def _text(name: str, value: Any) -> str:
    if np.ndim(value) == 2:
        ny, nx = np.shape(value)
        what = f"{np.count_nonzero(value)} bad" if name == "bad_pixels" else f"median {np.median(value):g}"
        return f"map {nx} x {ny}, {what}"
    if name == "shape":
        return f"{value[1]} x {value[0]}"
    return ", ".join(f"{v:g}" for v in np.atleast_1d(value))
