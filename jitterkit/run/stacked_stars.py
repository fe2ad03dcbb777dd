"""Faint stars that no frame of a run shows, in the residuals of all: each biases every frame's separation."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from astropy.table import QTable

from jitterkit.batch import FrameProcessor
from jitterkit.forward import GRADIENT, Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, Start, polished, with_further_stars
from jitterkit.loci import Mvn
from jitterkit.metric import invert_information
from jitterkit.optics import Optics
from jitterkit.refit import FitOptions, fit_frame
from jitterkit.report.columns import Column, aberration_column, bind_rows, measured
from jitterkit.report.residual_stack import FEWEST, ResidualStack, count_copies, most_stacked
from jitterkit.scene import Binary

_COLUMNS = (
    *measured("separation", "from A", "arcsec"),
    *measured("angle_from_b", "at A, from the direction of B, counter-clockwise in the frame", "deg"),
    *measured("delta_mag", "magnitudes by which it is fainter than A", "mag"),
    Column("sigmas", "flux over its standard error"),
)

_SEEN = 0.9
"""Share of the frames that must use a pixel of the stack for it to count."""


class StackedStars(NamedTuple):
    """Stars that no frame of a run shows.

    Attributes
    ----------
    table : QTable
        As ``[sky] stars`` of an instrument file takes it, with errors and significance.
    bias, bias_err : float
        Of the run's mean separation by the frames that were fitted without them, arcsec.
    """

    table: QTable
    bias: float
    bias_err: float

    def described(self, separation: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a run's summary says of them, whose mean separation is given."""
        cells = (self.table[name].value.tolist() for name in self.table.colnames)
        stars = [dict(zip(self.table.colnames, star, strict=True)) for star in zip(*cells, strict=True)]
        error = float(np.hypot(separation["error"], self.bias_err))
        without = {"bias": self.bias, "bias_err": self.bias_err}
        without |= {"mean": separation["mean"] - self.bias, "error": error}
        return {"further_stars": stars, "without_further_stars": without}


def find_stacked_stars(
    stacks: Mapping[str, ResidualStack], table: QTable, processor: FrameProcessor
) -> StackedStars | None:
    """Find stars beside a pair in the residuals of a run.

    Parameters
    ----------
    stacks : mapping of str to ResidualStack
        Of the run's frames, from :func:`~jitterkit.report.residual_stack.stack_residuals`; that of most pairs
        is searched.
    table : QTable
        Results of the frames.
    processor : FrameProcessor
        That fitted them.

    Returns
    -------
    stars : StackedStars or None
        None for none.

    Notes
    -----
    The stack is to its noise what the residual of one exposure is that lasted as long as all frames together:
    that exposure of the frames' median parameters is made, with the stack in it, and searched as a frame is.
    It is fitted with a pair and the stars, because the fit of each frame has explained a part of them.
    *Fails when* frames are turned against each other by as much as a star is wide.  *Assumes* that all pairs
    have one plate scale and are one pair.
    """
    status, shown, stars = (np.asarray(table[name], str) for name in ("status", "scene", "stars"))
    pairs = table[(status == "ok") & (shown == Binary.name) & (stars == "")]
    stack = most_stacked({name: one for name, one in stacks.items() if name.startswith(f"{Binary.name} at")})
    copies = count_copies(table)
    if stack is None or min(frames := stack.frames / copies, len(pairs)) < FEWEST:
        return None
    if np.any(pairs["model_error"] > 0):  # then sigmas are of more than light and read noise
        return None
    left, used = stack.sigmas(copies), stack.counts > _SEEN * stack.frames
    if not used.any():
        return None
    inside = _about_centre(np.any(used, axis=1)), _about_centre(np.any(used, axis=0))
    left, used = left[inside], used[inside]
    system = processor.instrument.system(shape=used.shape, plate_scale=stack.plate_scale)
    exposure = _exposure(pairs, frames, stack, system.names)
    otf = system.otf(exposure.aberrations)
    exposure = exposure.completed(otf)
    image, variance = np.asarray(expected_image(exposure, otf)), frames * stack.read_noise**2
    sigma = np.sqrt(np.maximum(image, 0.0) + variance)
    data = Data(image + np.nan_to_num(left) * sigma, variance, used)
    if Residual(data, image, otf, exposure.locus).further_stars(exposure.scene) is None:
        return None
    hold = processor.options.hold
    pair = polished(data, system, otf, exposure.scene, exposure.locus, hold)
    found = with_further_stars(pair, data, system, hold)
    scene = found.parameters.scene
    if scene.others is None:
        return None
    names = [name for name in scene.names if name in found.names]
    indices = [scene.names.index(name) for name in names]
    values = np.array(list(scene.values.values()))

    def relative(values):
        x, y, flux = scene.at(values).sources()
        dx, dy = x[1:] - x[0], y[1:] - y[0]
        angle = jnp.degrees(jnp.arctan2(dy, dx))
        magnitude = -2.5 * jnp.log10(flux[1:] / flux[0])
        return jnp.stack([jnp.hypot(dx, dy)[1:], (angle[1:] - angle[0]) % 360, magnitude[1:]])

    slopes = np.asarray(jax.jacfwd(relative)(values))[..., indices]
    errors = np.sqrt(np.einsum("ijk,kl,ijl->ij", slopes, found.covariance_of(names), slopes))
    sigmas = 2.5 / np.log(10) / errors[2]
    columns = zip(*np.stack([np.asarray(relative(values)), errors], 1).reshape(6, -1), sigmas, strict=True)
    share = _share(pairs, table)
    bias, bias_err = bias_without(found, data, system, hold)
    return StackedStars(bind_rows(_COLUMNS, columns), share * bias, share * bias_err)


def bias_without(found: Start, data: Data, optics: Optics, hold: Collection[str]) -> tuple[float, float]:
    """Return the bias of a separation that is fitted without further stars, and its error.

    Parameters
    ----------
    found : Start
        Fitted with a pair and further stars.
    data, optics, hold
        Of that fit.

    Returns
    -------
    bias, bias_err : float
        arcsec.
    """
    parameters, scene = found.parameters, found.parameters.scene
    assert scene.others is not None
    alone = eqx.tree_at(lambda p: p.scene.others, parameters, None)
    clean = Data(expected_image(parameters, found.otf), data.read_variance, data.used)
    fitted = fit_frame(clean, optics, alone, found.otf, FitOptions(hold=tuple(hold)))
    # of the error: what is fitted takes up the light of a star by the regression on it
    further = scene.others.named(len(scene.colours) + 1)
    kept = [name for name in found.names if name not in further]
    light = [name for name in further if name.startswith("flux_")]
    rows, columns = ([found.names.index(name) for name in names] for names in (kept, light))
    covariance, _ = invert_information(found.information[np.ix_(rows, rows)])
    per_flux = covariance[kept.index("separation")] @ found.information[np.ix_(rows, columns)]
    error = float(np.sqrt(per_flux @ found.covariance_of(light) @ per_flux))
    return fitted.of_scene("separation") - scene.values["separation"], error


def _share(pairs: QTable, table: QTable) -> float:
    """Return the weight of some frames in the mean separation of a run."""
    counted = table[np.asarray(table["status"], str) == "ok"]
    part, whole = (np.nansum(one["separation_err"].to_value("arcsec") ** -2.0) for one in (pairs, counted))
    return float(part / whole)


def _about_centre(used: np.ndarray) -> slice:
    """Return the smallest part, about the centre, of rows or columns (n,) that holds all that are used."""
    edge = min(int(np.argmax(used)), int(np.argmax(used[::-1])))
    return slice(edge, len(used) - edge)


def _exposure(pairs: QTable, frames: float, stack: ResidualStack, aberrations: tuple[str, ...]) -> Parameters:
    """Return what an exposure as long as all frames shows, with medians of their parameters."""

    def median(name: str) -> float:
        column = pairs[name] if name in pairs.colnames else np.zeros(1)
        values = np.asarray(getattr(column, "value", column))
        known = values[np.isfinite(values)]
        return float(np.median(known)) if len(known) else 0.0

    theta = pairs["theta"].to_value("deg")
    turned = float(np.median((theta - theta[0] + 180) % 360 - 180)) + theta[0]
    y, x = stack.position * stack.plate_scale
    flux, level = (frames * median(name) for name in ("flux", "background"))
    pair = Binary(median("separation"), turned, x, y, flux, median("contrast"))
    moments = np.array([median(name) for name in ("sxx", "sxy", "syy")])
    state = [median(aberration_column(name)) for name in aberrations]
    gradient = [frames * median(name) for name in GRADIENT]
    return Parameters(pair, Mvn.near(moments), state, level, gradient=gradient)
