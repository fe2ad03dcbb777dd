"""A calibration in rows and sentences, and its levels of light as a table.

Reach for :func:`calibration_rows`, :func:`calibration_sentences` and :func:`levels_table`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.calibration import FLAGS, Calibration, Stack
from jitterkit.calibration.stack_files import FILTER, TEMPERATURE
from jitterkit.report.columns import Column, bind
from jitterkit.report.words import number

_UNEVEN = 0.01
"""Of the smooth surface through the flat, from which it is said."""

_NAMES = {"bias": "bias", "read_noise": "read noise", "dark_current": "dark current"}

Row = tuple[str, float, float, str]


def calibration_rows(calibration: Calibration) -> list[Row]:
    """Return ``(quantity, value, error, unit)`` of what was measured; NaN where there is no error."""
    transfer = calibration.transfer
    rows: list[Row] = []
    if transfer is not None:
        rows.append(("gain", transfer.gain, transfer.gain_error, "e-/ADU"))
    for measured in calibration.maps:
        if measured.name in _NAMES:
            rows.append((_NAMES[measured.name], measured.number, measured.number_error, measured.unit))
    if transfer is not None:
        if calibration.read_noise is None and transfer.read_noise > 0:
            rows.append(("read noise", transfer.read_noise, transfer.read_noise_error, "e-"))
        prnu, error = calibration.prnu
        rows.append(("PRNU", 100 * prnu, 100 * error, "%"))
        if transfer.coupling:
            rows.append(("coupling", 100 * transfer.coupling, 100 * transfer.coupling_error, "%"))
        if transfer.linearity is not None:
            values, errors = transfer.linearity.in_electrons(transfer.gain)
            for k, (value, error) in enumerate(zip(values, errors, strict=True), 1):
                rows.append((f"nonlinearity c{k}", value, error, "1/e-" if k == 1 else f"1/e-^{k}"))
        if transfer.full_well is not None:
            rows.append(("full well", transfer.full_well, math.nan, "e-"))
        if transfer.saturation is not None and calibration.bias is not None:
            rows.append(("saturation", transfer.saturation + calibration.bias.number, math.nan, "ADU"))
    counted = (("hot pixels", "hot", calibration.dark_current), ("dead pixels", "dead", calibration.flat),
               ("noisy pixels", "noisy", calibration.read_noise))  # fmt: skip
    rows += [(name, calibration.count(flag), math.nan, "") for name, flag, made in counted if made]
    return rows


def calibration_sentences(calibration: Calibration) -> list[str]:
    """Return sentences on what a reader of the numbers should know."""
    # of the response what is local: the light's unevenness is no merit of the flats
    maps = [calibration.local if measured.name == "flat" else measured for measured in calibration.maps]
    sentences = [measured.sentence() for measured in maps if measured is not None]
    for kind, (left_out, of) in calibration.rejected.items():
        beyond = f"left out beyond {calibration.settings.clip:g} sigma"
        sentences.append(f"{kind} frames: {left_out} of {of} values {beyond}.")
    if calibration.hot_limit is not None:
        sentences.append(f"Hot: a dark current above {number(calibration.hot_limit, 3)} e-/s.")
    if calibration.gradient > _UNEVEN:
        sentences.append(_of_gradient(calibration))
    sentences += [] if calibration.transfer is None else _of_transfer(calibration)
    bad, pixels = int(np.count_nonzero(calibration.bad)), calibration.bad.size
    by = ", ".join(f"{calibration.count(flag)} {flag}" for flag in FLAGS if calibration.count(flag))
    sentences.append(f"{bad} of {pixels} pixels are bad" + (f" ({by})." if by else "."))
    return sentences


def _of_gradient(calibration: Calibration) -> str:
    size = f"The flats change smoothly by {100 * calibration.gradient:.1f} % over the frame"
    if calibration.settings.smooth:
        return f"{size}; that is divided out (--smooth), as the lamp's."
    kept = "that is kept, as if it were the detector's or the telescope's"
    return f"{size}; {kept}: if it is the lamp's, give --smooth."


_NO_LINE = 100.0
"""chi2 of a degree of freedom from which the gain is doubted: the brighter-fatter effect makes tens."""

_SMOOTH = 0.03
"""Coupling to one neighbour beyond that of detectors: 0.005 to 0.02 in the infrared, less elsewhere."""

_RISING, _BENT = 1.5, 5.0
"""Ratio of levels that are not full, and per cent off a line that no detector is."""


def _of_transfer(calibration: Calibration) -> list[str]:
    transfer = calibration.transfer
    assert transfer is not None
    lit = [level for level in transfer.levels if level.exposure > 0]
    full = sum(level.saturated for level in lit)
    left_out = f", {full} saturated and left out" if full else ""
    chi2 = f"; chi2 of the line {transfer.chi2:.3g} for {transfer.freedom}" if transfer.freedom else ""
    sentences = [f"Photon transfer: {len(lit)} levels of light{left_out}{chi2}."]
    if transfer.freedom and transfer.chi2 > _NO_LINE * transfer.freedom:
        said = "The variances do not lie on a line, so that the gain and all in electrons may be wrong"
        found = "give single exposures as they were read, neither scaled nor averaged, of one setting"
        sentences.append(f"{said}: {found}.")
    marked = [level.signal for level in transfer.levels if level.saturated]
    if len(marked) > 1 and marked[-1] > _RISING * marked[0]:
        sentences.append(
            f"The {full} levels left out differ by a factor of {marked[-1] / marked[0]:.2g}, and full pixels "
            "do not: if frames were stretched, or lack a bias that others have, the gain is wrong."
        )
    if transfer.linearity is None:
        needs = "it takes three exposure times below saturation, of one lamp"
        sentences.append(f"Linearity is not measured: {needs}.")
    elif not transfer.linearity.coefficients:
        worst = 100 * float(np.max(np.abs(transfer.linearity.residuals)))
        sentences.append(f"No non-linearity is significant; the levels lie within {worst:.2g} % of a line.")
        if worst > _BENT:
            remedy = "check the exposures, and that all frames have one bias level"
            sentences.append(f"No detector does that: {remedy}.")
    if transfer.coupling > _SMOOTH:
        said = f"The coupling of {100 * transfer.coupling:.2g} % is larger than detectors have"
        found = "if the flats were smoothed or resampled, the gain and all in electrons are wrong"
        sentences.append(f"{said}: {found}.")
    if not transfer.coupling and math.isfinite(transfer.coupling_error):
        error = f"(error {100 * transfer.coupling_error:.2g} %)"
        sentences.append(f"No coupling to the neighbours is significant {error}.")
    return sentences


def stack_sentences(stacks: Sequence[Stack]) -> list[str]:
    """Return what makes frames doubtful as calibration frames.

    These are their files' warnings, numbers that are not whole, temperatures apart, flats of several filters
    and unlit frames of one exposure whose levels differ.
    """
    sentences = [*_of_temperature(stacks), *_of_filters(stacks), *_of_levels(stacks)]
    for kind in dict.fromkeys(stack.kind for stack in stacks):
        shots = [shot for stack in stacks if stack.kind == kind for shot in stack.shots]
        said = Counter(warning for shot in shots for warning in shot.warnings)
        sentences += [f"{count} of {len(shots)} {kind} frames: {text}." for text, count in said.items()]
        if not all(shot.whole for shot in shots):
            doubt = "of frames that were averaged or scaled, noise and gain are not the detector's"
            sentences.append(f"The {kind} frames are not whole numbers: {doubt}.")
        if kind != "flat" and any(shot.clipped for shot in shots):
            remedy = "so that level and read noise are wrong: give the camera a higher offset"
            sentences.append(f"The {kind} frames are cut off at zero, {remedy}.")
    return sentences


_APART = 3.0
"""Kelvins: the dark current of silicon doubles with every six."""


def _of_temperature(stacks: Sequence[Stack]) -> list[str]:
    shots = (shot for stack in stacks for shot in stack.shots)
    cells = (shot.settings.get(TEMPERATURE, "") for shot in shots)
    numbers = [float(cell) for cell in cells if re.fullmatch(r"[-+]?\d+\.?\d*", cell)]
    known = [number for number in numbers if -200 < number < 80]
    if not known or max(known) - min(known) <= _APART:
        return []
    spread = f"of {min(known):g} to {max(known):g} degrees ({TEMPERATURE})"
    doubling, remedy = "doubles with about every six", "give frames of the temperature of the observations"
    return [f"The frames are {spread}, and the dark current {doubling}: {remedy}."]


def _of_filters(stacks: Sequence[Stack]) -> list[str]:
    shots = (shot for stack in stacks if stack.kind == "flat" for shot in stack.shots)
    filters = sorted({shot.settings[FILTER] for shot in shots if FILTER in shot.settings})
    if len(filters) < 2:
        return []
    return [f"The flats are of several filters ({', '.join(filters)}): calibrate each by itself."]


def _of_levels(stacks: Sequence[Stack]) -> list[str]:
    """Name the unlit stacks whose frames differ by more than the noise of a pixel, as no two of a kind do."""
    sentences = []
    for stack in (stack for stack in stacks if stack.kind != "flat"):
        levels = [shot.level for shot in stack.shots]
        if max(levels) - min(levels) > min(shot.scatter for shot in stack.shots):
            said = (
                f"The levels of the {stack.name} frames run from {min(levels):.5g} to {max(levels):.5g} ADU"
            )
            remedy = "check that they are of one exposure, offset and temperature"
            sentences.append(f"{said}, so that their mean and noise are wrong: {remedy}.")
    return sentences


_LEVELS = (
    ("exposure", Column("exposure", "exposure time", "s")),
    ("frames", Column("frames", "number of flats", kind=int)),
    ("signal", Column("signal", "mean above the bias", "adu")),
    ("signal_error", Column("signal_err", "standard error of signal", "adu")),
    ("variance", Column("variance", "of a pixel from frame to frame", "adu2")),
    ("variance_error", Column("variance_err", "standard error of variance", "adu2")),
    ("covariance", Column("covariance", "with neighbouring pixels", "adu2")),
    ("spatial_variance", Column("spatial_variance", "of the mean over pixels", "adu2")),
    ("prnu", Column("prnu", "photo-response non-uniformity, as a share of the signal")),
    ("saturated", Column("saturated", "whether pixels saturate", kind=bool)),
)
"""Attribute of a level of light, and its column."""


def levels_table(calibration: Calibration, command: str = "") -> QTable:
    """Return the levels of light, a row each, with units; empty without flats."""
    transfer = calibration.transfer
    levels = () if transfer is None else transfer.levels
    columns = [(column, [getattr(level, name) for level in levels]) for name, column in _LEVELS]
    described: dict[str, Any] = {"command": command}
    for name, value, error, unit in calibration_rows(calibration):
        described[name] = [value, None if math.isnan(error) else error, unit]
    return bind(columns, described)
