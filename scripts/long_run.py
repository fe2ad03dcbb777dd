"""A run of any length as rows of the table: what a night of 60,000 exposures leaves, without fitting any.

Ten reasons fail 3 % of the frames, the separation drifts, cosmic rays spoil two frames in a thousand, the
jitter grows and turns, four loci are mixed, and the spacecraft loses the target once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from datetime import datetime, timedelta

import numpy as np

from jitterkit.report.columns import COLUMNS

ERROR = 465e-6
SEPARATION, DRIFT = 10.0, 1e-9
"""arcsec, and arcsec a frame: an eighth of an error over 60,000."""

CADENCE, GAP = 0.1, 0.4
"""Seconds from frame to frame, and the time without the target as a share of the rest."""

DOF = 16365
LOCI = ("linear", "shm", "mvn", "stable")
SHARES = (0.55, 0.2, 0.2, 0.05)
SHAPES = {"linear": -1.2, "shm": -1.5, "mvn": 0.0, "stable": math.nan}
ABERRATIONS = tuple(f"noll{j}" for j in range(4, 11))
FAILURES = (
    (
        "poor_fit",
        "model_mismatch",
        "the model does not describe the frame: chi²/dof is {x:.4g}. Free the background.",
    ),
    ("not_converged", "not_converged", "the fit did not settle within its iterations."),
    ("no_star", "no_star", "{path}: holds no star ({n} pixels above {x:.3g} sigma); give a longer exposure."),
    ("no_pair", "no_pair", "only one star is seen: a second one is lost in its noise."),
    ("no_data", "no_data", "no usable pixel: {n} of 16384 are masked."),
    (
        "unreadable",
        "truncated",
        "{path}: holds {n} bytes of the 65536 declared; it is truncated: copy it again.",
    ),
    ("unreadable", "unknown_format", "{path}: is text, not a FITS or TIFF file; give a frame."),
    ("unreadable", "damaged", "{path}: has a FITS header without an END card; copy it again."),
    (
        "mismatch",
        "wrong_instrument",
        "the frame does not suit this instrument: pixels of {x:.4f} arcsec, not 0.375.",
    ),
    ("failed", "internal", "the fit broke down: the information is singular after {n} steps."),
)
"""Status, reason and message of each kind of failure; values in braces differ from frame to frame."""


def long_run(n: int, rng: np.random.Generator, *, failing: float = 0.03) -> Iterator[dict]:
    """Rows of ``n`` frames, one by one.

    Parameters
    ----------
    n : int
    rng : numpy.random.Generator
    failing : float
        Share of the frames that fail.

    Yields
    ------
    row : dict
        As :func:`jitterkit.report.row.make_row` makes them.
    """
    blank = {column.name: column.blank for column in COLUMNS}
    start = datetime(2027, 3, 1, 3)
    errors = ERROR * rng.lognormal(0, 0.05, n)
    values = SEPARATION + DRIFT * np.arange(n) + errors * rng.standard_normal(n)
    values += 12 * errors * (rng.random(n) < 0.002) * rng.choice([-1, 1], n)
    part = np.arange(n) / n
    major = 0.12 * (1 + part) * rng.lognormal(0, 0.15, n)
    minor = major * rng.beta(2, 5, n)
    angle = (150 + 60 * part + 9 * rng.standard_normal(n)) % 180
    loci = rng.choice(len(LOCI), n, p=SHARES)
    reasons = np.where(rng.random(n) < failing, rng.integers(len(FAILURES), size=n), -1)
    chi2 = rng.normal(1, math.sqrt(2 / DOF), n) + (rng.random(n) < 0.003) * rng.exponential(0.1, n)
    shape = 0.3 * rng.standard_normal(n)
    for k in range(n):
        name = f"alpha_cen_{k:06d}.fits"
        at = start + timedelta(seconds=CADENCE * k + GAP * n * CADENCE * (k > n // 2))
        path = f"/data/night_17/{name}"
        row = {**blank, "file": name, "path": path, "seconds": 0.4, "exposure": 0.1, "dof": 0}
        if reasons[k] >= 0:
            status, reason, sentence = FAILURES[reasons[k]]
            row |= {"status": status, "reason": reason}
            row |= {"message": sentence.format(path=path, n=17 * k + 3, x=1.6 + major[k])}
            row |= {"time": "" if status == "unreadable" else at.isoformat()}
            yield row
            continue
        locus = LOCI[loci[k]]
        a, b = (0.0, 0.0) if locus == "stable" else (major[k], 0.0 if loci[k] < 2 else minor[k])
        c, s = math.cos(math.radians(angle[k])), math.sin(math.radians(angle[k]))
        row |= {
            "time": at.isoformat(), "status": "ok", "message": f"fitted: chi²/dof is {chi2[k]:.4g}.",
            "locus": locus, "locus_weight": 0.7, "flags": 4 * (locus == "stable"),
            "separation": values[k], "separation_err": errors[k], "separation_crlb": 0.98 * errors[k],
            "separation_spread": 2e-6, "theta": 204.3, "theta_err": 0.003,
            "x": 0.3 * part[k], "x_err": 3e-4, "y": -0.2, "y_err": 3e-4, "x_pixel": 63.5, "y_pixel": 63.5,
            "flux": 9.53e6, "flux_err": 3300.0, "contrast": 3.37, "contrast_err": 0.0037,
            "sxx": a**2 * c**2 + b**2 * s**2, "sxx_err": 7e-5,
            "sxy": (a**2 - b**2) * c * s, "sxy_err": 6e-5,
            "syy": a**2 * s**2 + b**2 * c**2, "syy_err": 9e-5,
            "jitter_major": a, "jitter_minor": b, "jitter_angle": angle[k] if a else math.nan,
            "jitter_length": a * math.sqrt(12) if loci[k] == 0 else math.nan,
            "shape": SHAPES[locus] + shape[k], "shape_err": 0.3 if a else math.nan,
            "background": 0.0, "chi2_dof": chi2[k], "dof": DOF, "iterations": 5,
            "candidates": _candidates(values[k], locus),
        }  # fmt: skip
        row |= {f"{name}{end}": 0.05 * k % 3 for name in ABERRATIONS for end in ("", "_err")}
        yield row


def _candidates(separation: float, best: str) -> str:
    same = {"separation": round(separation, 9), "separation_err": ERROR}
    tried = [
        {
            "locus": name,
            "weight": 0.7 - 0.6 * worse,
            "objective": 16400.0 + 3 * worse,
            "evidence": -2.0 * worse,
        }
        for name, worse in sorted(((name, name != best) for name in LOCI), key=lambda pair: pair[1])
    ]
    return json.dumps([one | same for one in tried], separators=(",", ":"))
