"""Make the table of the stars of frames that show more than a pair."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from jitterkit.report.columns import Column, bind_rows, measured, named

if TYPE_CHECKING:  # at run time a table is read without JAX
    from astropy.table import QTable

    from jitterkit.refit.result import FitResult


_COLUMNS = (
    *named("file", "frame"),
    Column("star", "from 1; A and B of a pair are 1 and 2", kind=int),
    *measured("x", "offset from the frame's centre", "arcsec"),
    *measured("y", "offset from the frame's centre", "arcsec"),
    *measured("flux", "electrons per frame, inside the frame or not", "electron"),
)


def encode_stars(result: FitResult) -> str:
    """Write all stars of a frame as JSON; empty where it shows no further star.

    Of each ``[x, x_err, y, y_err, flux, flux_err]``, arcsec and electrons; null where an error is not known.
    """
    if result.parameters is None or result.parameters.scene.others is None:
        return ""
    import jax  # loaded already by whoever holds a FitResult

    scene = result.parameters.scene
    values = np.array(list(scene.values.values()))
    slopes = jax.jacfwd(lambda v: scene.at(v).sources())(values)
    indices = [name in result.names for name in scene.names]
    fitted = [result.names.index(name) for name in scene.names if name in result.names]
    covariance = np.zeros((len(values), len(values)))
    covariance[np.ix_(indices, indices)] = result.covariance[np.ix_(fitted, fitted)]
    numbers = []
    for value, slope in zip(scene.sources(), map(np.asarray, slopes), strict=True):
        with np.errstate(invalid="ignore"):  # a fit that broke down may have a negative variance
            numbers += [np.asarray(value), np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance, slope))]
    rounded = [
        [float(f"{v:.9g}") if np.isfinite(v) else None for v in star] for star in zip(*numbers, strict=True)
    ]
    return json.dumps(rounded, separators=(",", ":"))


def star_table(results: QTable) -> QTable | None:
    """List the stars of all frames of a results table that show more than a pair.

    Parameters
    ----------
    results : QTable
        As :func:`~jitterkit.report.table.make_table` binds it.

    Returns
    -------
    stars : QTable or None
        None if no frame does.  Columns ``file``, ``frame``, ``star`` (from 1; A and B of a pair are 1 and
        2), ``x``, ``y`` [arcsec] and ``flux`` [electron] with their errors.
    """
    rows = [
        (str(row["file"]), int(row["frame"]), number, *(np.nan if v is None else v for v in star))
        for row in results
        if row["stars"]
        for number, star in enumerate(json.loads(row["stars"]), 1)
    ]
    return bind_rows(_COLUMNS, rows) if rows else None
