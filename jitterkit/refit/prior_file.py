"""Priors on the jitter from a file: estimates of other frames, or a telemetry trace.

Reach for :func:`read_kernel_prior`; the batch asks what it returns for the prior of each frame by name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from astropy.table import QTable

from jitterkit.errors import ConfigurationError, ErrorCode, reading_code
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import read_trace
from jitterkit.refit.priors import (
    OTHERS,
    Priors,
    kernel_prior,
    same_frame,
    sequence_prior,
    trace_prior,
    whole_exposures,
)

_MOMENTS = ("sxx", "sxy", "syy")

_LONGER = 1.01
"""Exposures: a trace no longer than this covers one, and a sample or two over is nothing to remark on."""

CORRELATIONS = {"sxx_sxy_corr": (0, 1), "sxx_syy_corr": (0, 2), "sxy_syy_corr": (1, 2)}
"""Columns of a table of estimates that hold the correlation of two moments, and which."""


@dataclass(frozen=True)
class KernelPrior:
    """Hold the jitter of frames as a file gives it.

    Attributes
    ----------
    source : str
        The file.
    estimates : tuple of KernelEstimate
        Of frames, each with its source; or
    telemetry : Priors
        the same for every frame.
    remark : str
        A sentence on what of the file is used, where a reader may expect more; else empty.
    """

    source: str
    estimates: tuple[KernelEstimate, ...] = ()
    telemetry: Priors | None = None
    remark: str = ""

    def of(self, frame: str, digest: str = "") -> Priors:
        """The prior for a frame by name and digest, without anything that was made of that very frame.

        Of a single estimate that is :func:`~jitterkit.refit.priors.kernel_prior`, empty if it is the frame's
        own; of several :func:`~jitterkit.refit.priors.sequence_prior`.
        """
        if self.telemetry is not None:
            return self.telemetry
        if len(self.estimates) == 1:
            return kernel_prior(self.estimates[0], frame, digest)
        return sequence_prior(self.estimates, frame, digest)

    def remark_on(self, frame: str, digest: str = "") -> tuple[str, str]:
        """Return a sentence on what the prior of a frame was made of, and its flag; empty if all is well.

        Of a single estimate whose name is the frame's, but not the pixels, the exposure may be the same.
        """
        if self.of(frame, digest) == Priors():
            return "The prior holds this frame only and was not used.", "prior_unused"
        if len(self.estimates) == 1 and same_frame(replace(self.estimates[0], digest=""), frame, ""):
            return (
                f"The prior was estimated from {self.estimates[0].source}, of other pixels: if that is the "
                "same exposure, reduced otherwise, its light counts twice and errors are too small.",
                "prior_namesake",
            )
        return "", ""


def read_kernel_prior(
    path: str | Path, uncertainty: float = 0.1, exposure: float | None = None
) -> KernelPrior:
    """Read a prior on the jitter.

    Parameters
    ----------
    path : str or Path
        A table that ``jitterkit estimate -o`` wrote (ECSV), or a trace (CSV with the columns ``t,x,y``:
        seconds and arcsec).
    uncertainty : float
        Relative error of a trace's rms.
    exposure : float, optional
        Seconds; a longer trace is cut into pieces of it, see Notes.

    Returns
    -------
    prior : KernelPrior

    Raises
    ------
    ConfigurationError
        If the file cannot be read, has not these columns, or holds no estimate.

    Notes
    -----
    A trace is not matched with the times of frames: every frame gets the same prior.  Of a trace of two
    exposures or more that is the mean of the whole exposures in it, as wide as they scatter; of one between
    one and two, its first exposure.  The record's ``remark`` says so.

    Whose row is whose the column ``digest`` decides, by the pixels of the raw frame; in a table without it
    the file's name and the frame's index do.  What correlation the moments have stands in the columns
    :data:`CORRELATIONS`; in a table without them it is taken for none.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        t, x, y = read_trace(path)
        return KernelPrior(
            str(path),
            telemetry=trace_prior(t, x, y, uncertainty, exposure),
            remark=_surplus(float(t[-1] - t[0]), exposure),
        )
    table = _read(path)
    estimates = [_estimate(row) for row in table if row["status"] == "ok"]
    good = tuple(filter(_is_sound, estimates))
    if not good:
        problem = f"{path} holds no kernel estimate; none of its {len(table)} frames is ok."
        raise ConfigurationError(ErrorCode.NO_DATA, problem)
    if 1 < len(good) <= OTHERS:  # of each frame its own is left out
        problem = f"{path} holds estimates of {len(good)} frames; give one, or {OTHERS + 1} or more"
        raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}: fewer do not show how jitter scatters.")
    return KernelPrior(str(path), good)


def _surplus(duration: float, exposure: float | None) -> str:
    """A sentence where a trace is longer than an exposure."""
    if exposure is None or duration <= exposure * _LONGER:
        return ""
    pieces = whole_exposures(duration, exposure)
    if pieces == 1:
        return f"The first {exposure:g} of {duration:g} s of the trace are used for every frame."
    return (
        f"The trace lasts {duration:g} s: the mean of its {pieces} exposures of {exposure:g} s and their "
        "scatter are used for every frame."
    )


def _read(path: Path) -> QTable:
    wanted = ("file", "frame", "status", "estimator", *_MOMENTS, *(f"{name}_err" for name in _MOMENTS))
    try:
        table = QTable.read(path, format="ascii.ecsv")
    except (OSError, ValueError) as error:
        problem = f"{path} cannot be read as a table ({_first_line(error)})"
        remedy = "give what 'jitterkit estimate -o' wrote, or a trace as .csv"
        raise ConfigurationError(reading_code(error), f"{problem}; {remedy}.") from None
    missing = [name for name in wanted if name not in table.colnames]
    if missing:
        problem = f"{path} has no column {missing[0]!r}; give a table that 'jitterkit estimate -o' wrote."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    for name in wanted[4:]:
        if getattr(table[name], "unit", None) != "arcsec2":
            problem = f"{path}: the column {name!r} is not in arcsec2; estimate it again."
            raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, problem)
    for name in wanted[4:]:
        if np.any(getattr(table[name], "mask", False)):  # empty cells, which have zeros beneath
            table[name] = table[name].filled(np.nan)
    return table


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _estimate(row) -> KernelEstimate:
    moments, errors = (
        np.array([row[f"{name}{end}"].to_value("arcsec2") for name in _MOMENTS]) for end in ("", "_err")
    )
    correlation = np.eye(3)
    for name, (i, j) in CORRELATIONS.items():
        if name in row.colnames:
            correlation[i, j] = correlation[j, i] = row[name]
    source = f"{row['file']}[{row['frame']}]"
    return KernelEstimate(
        moments, correlation * np.outer(errors, errors), str(row["estimator"]), source, digest=_digest(row)
    )


def _digest(row) -> str:
    """Return the digest of a row; empty in an older table, or one joined to such."""
    known = "digest" in row.colnames and not np.ma.is_masked(row["digest"])
    return str(row["digest"]) if known else ""


def _is_sound(estimate: KernelEstimate) -> bool:
    """Return whether moments are finite, and have a covariance."""
    finite = np.all(np.isfinite(estimate.moments)) and np.all(np.isfinite(estimate.covariance))
    return bool(finite and np.linalg.eigvalsh(estimate.covariance)[0] > 0)
