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

__all__ = ["KernelPrior", "read_kernel_prior"]

_MOMENTS = ("sxx", "sxy", "syy")


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
    The table holds errors of the moments, not their correlations, which are left out: between sxx and syy
    they are small on TOLIMAN.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return KernelPrior(str(path), telemetry=trace_prior(*read_trace(path), uncertainty, exposure))
    table = _read(path)
    good = table[(np.asarray(table["status"]) == "ok") & _is_sound(table)]
    if not len(good):
        raise ConfigurationError(f"{path} holds no kernel estimate; none of its {len(table)} frames is ok.")
    if 1 < len(good) <= OTHERS:  # of each frame its own is left out
        raise ConfigurationError(
            f"{path} holds estimates of {len(good)} frames; give one, or {OTHERS + 1} or more: fewer do not "
            "show how jitter scatters."
        )
    return KernelPrior(str(path), tuple(_estimate(row) for row in good))


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


def _is_sound(table: QTable) -> np.ndarray:
    """Rows whose moments are numbers, with errors."""
    errors = np.array([table[f"{name}_err"].value for name in _MOMENTS])
    moments = np.array([table[name].value for name in _MOMENTS])
    return np.all(np.isfinite(moments) & np.isfinite(errors) & (errors > 0), axis=0)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _estimate(row) -> KernelEstimate:
    moments, errors = (
        np.array([row[f"{name}{end}"].to_value("arcsec2") for name in _MOMENTS]) for end in ("", "_err")
    )
    source = f"{row['file']}[{row['frame']}]"
    return KernelEstimate(moments, np.diag(errors**2), str(row["estimator"]), source)
