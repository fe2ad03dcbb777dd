"""Whether a wavefront error that a fit lacks explains its misfit: further modes, or a focus that changes.

Reach for :func:`describe_lacking_wavefront`.  Nothing is fitted again: a score test (Rao, Proc. Camb. Phil.
Soc. 44, 50, 1948) has the gain in chi-squared by one scoring step, all that was fitted being free beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy import stats

from jitterkit.conventions import offsets
from jitterkit.forward import Parameters, expected_image, parameter_names
from jitterkit.likelihood import Data, equations_of, single_slopes
from jitterkit.optics.otf import OTF
from jitterkit.optics.pupil import Pupil, zernike
from jitterkit.optics.system import OpticalSystem, Optics
from jitterkit.refit.result import FitResult

_LAST = 36
"""Noll's number of the last mode that is tried: the end of the seventh order."""

_CHANCE = 1e-6
"""Chance that noise makes any of the directions tried gain so much."""

_SHARE, _PART = 0.5, 0.05
"""Share of the excess of chi-squared that the directions must explain, because other causes look like a
wavefront in part; and that each must add to those before it."""

_OWN = 1e-3
"""Share of a direction's information that what was fitted must leave of it."""

_LINEAR = 0.5
"""Rms phase [rad] up to which one step gives sizes."""

_PADDING = 16
"""Fine samples on each side: slopes of TOLIMAN's image are off by 1e-4 of themselves, in half of the time."""

_FOCUS = "an rms change of focus during the exposure"

_STEP = 10.0
"""Focus [nm] of the second difference of an image: the fourth derivative weighs 1e-3."""


def describe_lacking_wavefront(result: FitResult, data: Data, optics: Optics, near: OTF) -> str:
    """Say in a sentence which wavefront error explains most of a misfit; nothing where none does.

    Parameters
    ----------
    result : FitResult
        With more chi-squared than noise makes.
    data : Data
        The frame's.
    optics : Optics
        None but a pupil's wavefront can be another one.
    near : OTF
        About aberrations near the fitted ones.

    Notes
    -----
    Tried are Noll's modes up to 36 that the pupil lacks, over the circle about its light, and where focus was
    fitted its variance during the exposure: the best first, then what adds most to it.
    *Fails when* a mode shows to second order only, as even ones do of a pupil that is its own mirror image.
    """
    system, p = optics.system, result.parameters
    excess = result.chi2 - result.dof
    if not isinstance(system, OpticalSystem) or p is None or result.residual is None or not excess > 0:
        return ""
    modes = [number for number in range(4, _LAST + 1) if f"noll{number}" not in system.pupil.names]
    lacking = _with_modes(system, p, modes)
    bare, otf = Parameters(p.scene, p.locus, np.zeros(len(modes)), diffusion=p.diffusion), lacking.otf(None)
    further = [_slopes(bare, otf, otf.names)] if modes else []
    further += [_focus_variance_slope(lacking, bare, otf)] if "noll4" in result.names else []
    if not further or not np.all(np.isfinite(result.covariance)):
        return ""
    fitted = _slopes(p, near, result.names)
    score, information = _beside_fitted(result, data, fitted, np.concatenate(further))
    chosen = _chosen(score, information, _PART * excess, len(modes))
    covariance = np.linalg.inv(information[np.ix_(chosen, chosen)])
    sizes, errors = covariance @ score[chosen], np.sqrt(np.diag(covariance))
    share = float(sizes @ score[chosen]) / excess
    errors = errors * math.sqrt(max(result.chi2 - share * excess, result.dof) / result.dof)
    found = [
        _Found(f"Noll {modes[k]}", size, error)
        if k < len(modes)
        else _Found(_FOCUS, math.sqrt(max(size, 0.0)), error / 2 / math.sqrt(abs(size)))
        for k, size, error in zip(chosen, sizes, errors, strict=True)
    ]
    total = math.sqrt(sum(one.size**2 for one in found))
    if not share > _SHARE or 2 * np.pi / min(system.spectrum.wavelengths) * total > _LINEAR:
        return ""
    return _sentence(found, min(share, 1.0))


class _Found(NamedTuple):
    """A mode, or the rms change of focus, with size and error [nm]."""

    name: str
    size: float
    error: float


def _sentence(found: Sequence[_Found], share: float) -> str:
    named = " and ".join(f"{one.name} of {one.size:.3g} ± {one.error:.1g} nm" for one in found)
    listed = ", ".join(one.name.removeprefix("Noll ") for one in found if one.name != _FOCUS)
    remedy = f": add {listed} to noll in [telescope] of the instrument file, or to its pupil file"
    claim = f"{named[0].upper()}{named[1:]} would explain {100 * share:.0f} %"
    return f"{claim} of the excess of chi-squared{remedy if listed else ''}."


def _with_modes(system: OpticalSystem, p: Parameters, modes: Sequence[int]) -> OpticalSystem:
    """Return a system in the state of a fit, with other modes that may vary."""
    pupil, names = system.pupil, [f"noll{number}" for number in modes]
    state, count = system.further.split(p.aberrations, len(pupil.names))[0], len(pupil.basis)
    opd = pupil.opd + np.tensordot(state[:count], pupil.basis, 1)
    amplitude = pupil.transmission * np.exp(np.tensordot(state[count:], pupil.shading, 1))
    basis = _planes(pupil, modes)
    there = Pupil(amplitude, pupil.diameter, opd, basis, names, light=float(pupil.light))
    colours = None if system.colours is None else replace(system.colours, wavelength_err=0.0)
    grid = replace(system.grid, pad=min(system.grid.pad, -(-_PADDING // system.grid.refine)))
    return replace(system, pupil=there, grid=grid, colours=colours, plate_scale_sigma=0.0, of_b=())


def _planes(pupil: Pupil, modes: Sequence[int]) -> np.ndarray:
    """Return Noll's modes (k, n, n) over the circle as wide as a pupil's light."""
    axis = offsets(len(pupil.opd), 2 * pupil.pitch / pupil.cutoff_diameter)
    return np.array([zernike(number, *np.meshgrid(axis, axis)) for number in modes]).reshape(
        -1, *pupil.opd.shape
    )


def _slopes(p: Parameters, otf: OTF, names: Sequence[str]) -> np.ndarray:
    """Return the derivatives (k, ny, nx) of an image by some of its parameters."""
    every = parameter_names(p, otf.names)
    return np.asarray(single_slopes(p, otf, tuple(map(every.index, names)))[1], float)


def _focus_variance_slope(system: OpticalSystem, p: Parameters, otf: OTF) -> np.ndarray:
    """Return the derivative (1, ny, nx) of an image by the variance [nm²] of focus during the exposure."""
    pupil = system.pupil
    step = _STEP * _planes(pupil, [4])[0]
    there = [
        replace(system, pupil=eqx.tree_at(lambda u: u.opd, pupil, pupil.opd + by)) for by in (step, -step)
    ]
    off = [np.asarray(expected_image(p, one.otf(None, derivatives=False))) for one in there]
    return (sum(off) / 2 - np.asarray(expected_image(p, otf)))[None] / _STEP**2


def _beside_fitted(
    result: FitResult, data: Data, fitted: np.ndarray, further: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return score and information of further directions, with all that was fitted free beside them.

    Of what the fitted parameters take up but for a thousandth, the score is zero.
    """
    assert result.residual is not None
    used, count = data.without(~np.isfinite(result.residual)), len(fitted)
    _, score, information = map(np.array, equations_of(result.image, np.concatenate([fitted, further]), used))
    taken_up = information[count:, :count] @ result.covariance
    left = information[count:, count:] - taken_up @ information[:count, count:]
    seen = np.diag(left) > _OWN * np.diag(information)[count:]
    return np.where(seen, score[count:] - taken_up @ score[:count], 0.0), left


def _chosen(score: np.ndarray, information: np.ndarray, least: float, signed: int) -> list[int]:
    """Choose directions one after the other, while the best of the rest is significant and gains enough.

    From ``signed`` on, sizes cannot be negative.
    """
    chosen: list[int] = []
    while True:
        own = np.diag(information)
        free = (
            (own > 0)
            & ((score > 0) | (np.arange(len(score)) < signed))
            & ~np.isin(np.arange(len(score)), chosen)
        )
        gains = np.divide(score**2, own, out=np.zeros(len(score)), where=free)
        best = int(gains.argmax())
        if gains[best] < least or len(score) * stats.chi2.sf(gains[best], 1) > _CHANCE:
            return chosen
        share = information[best] / own[best]
        score, information = score - share * score[best], information - np.outer(share, information[best])
        chosen.append(best)
