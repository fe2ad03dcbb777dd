"""Priors on the jitter from a file: estimates of other frames, or a telemetry trace.

Reach for :func:`read_kernel_prior`; the batch asks what it returns for the prior of each frame by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from astropy.table import QTable

from jitterkit.errors import ConfigurationError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import read_trace
from jitterkit.refit.priors import OTHERS, Priors, kernel_prior, sequence_prior, trace_prior

__all__ = ["CORRELATIONS", "KernelPrior", "read_kernel_prior"]

_MOMENTS = ("sxx", "sxy", "syy")

CORRELATIONS = {"sxx_sxy_corr": (0, 1), "sxx_syy_corr": (0, 2), "sxy_syy_corr": (1, 2)}
"""Columns of a table of estimates that hold the correlation of two moments, and which."""


@dataclass(frozen=True)
class KernelPrior:
    """What a file says about the jitter of frames.

    Attributes
    ----------
    source : str
        The file.
    estimates : tuple of KernelEstimate
        Of frames, each with its source; or
    telemetry : Priors
        the same for every frame.
    """

    source: str
    estimates: tuple[KernelEstimate, ...] = ()
    telemetry: Priors | None = None

    def of(self, frame: str) -> Priors:
        """The prior for a frame by its name, without anything that was made of that very frame.

        Of a single estimate that is :func:`~jitterkit.refit.priors.kernel_prior`, of several
        :func:`~jitterkit.refit.priors.sequence_prior`.
        """
        if self.telemetry is not None:
            return self.telemetry
        if len(self.estimates) == 1:
            return kernel_prior(self.estimates[0], frame)
        return sequence_prior(self.estimates, frame)


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
        Seconds; a longer trace is cut into pieces of it.

    Returns
    -------
    prior : KernelPrior

    Raises
    ------
    ConfigurationError
        If the file cannot be read, has not these columns, or holds no estimate.

    Notes
    -----
    What correlation the moments have stands in the columns :data:`CORRELATIONS`; in a table without them
    it is taken for none.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return KernelPrior(str(path), telemetry=trace_prior(*read_trace(path), uncertainty, exposure))
    table = _read(path)
    estimates = [_estimate(row) for row in table if row["status"] == "ok"]
    good = tuple(filter(_is_sound, estimates))
    if not good:
        raise ConfigurationError(f"{path} holds no kernel estimate; none of its {len(table)} frames is ok.")
    if 1 < len(good) <= OTHERS:  # of each frame its own is left out
        raise ConfigurationError(
            f"{path} holds estimates of {len(good)} frames; give one, or {OTHERS + 1} or more: fewer do not "
            "show how jitter scatters."
        )
    return KernelPrior(str(path), good)


def _read(path: Path) -> QTable:
    wanted = ("file", "frame", "status", "estimator", *_MOMENTS, *(f"{name}_err" for name in _MOMENTS))
    try:
        table = QTable.read(path, format="ascii.ecsv")
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"{path} cannot be read as a table ({_first_line(error)}); give what 'jitterkit estimate -o' "
            "wrote, or a trace as .csv."
        ) from None
    missing = [name for name in wanted if name not in table.colnames]
    if missing:
        raise ConfigurationError(
            f"{path} has no column {missing[0]!r}; give a table that 'jitterkit estimate -o' wrote."
        )
    for name in wanted[4:]:
        if getattr(table[name], "unit", None) != "arcsec2":
            raise ConfigurationError(f"{path}: the column {name!r} is not in arcsec2; estimate it anew.")
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
    return KernelEstimate(moments, correlation * np.outer(errors, errors), str(row["estimator"]), source)


def _is_sound(estimate: KernelEstimate) -> bool:
    """Whether moments are numbers, and have a covariance."""
    finite = np.all(np.isfinite(estimate.moments)) and np.all(np.isfinite(estimate.covariance))
    return bool(finite and np.linalg.eigvalsh(estimate.covariance)[0] > 0)
