"""What ``scripts/extremes`` compares with: blur as shifted images, stars by Fraunhofer's integral."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np

from jitterkit.conventions import ARCSEC
from jitterkit.forward import Parameters, expected_image
from jitterkit.instruments import Instrument
from jitterkit.loci import Stable
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Scene

__all__ = ["along", "direct", "motion", "normal", "shifted"]


def shifted(scene: Binary, otf: OTF, offsets: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Sum of unblurred images at offsets (n, 2) [arcsec] of the pointing: what a blur is by definition."""

    def add(total, step):
        (x, y), weight = step
        moved = eqx.tree_at(lambda s: (s.x, s.y), scene, (scene.x + x, scene.y + y))
        return total + weight * expected_image(Parameters(moved, Stable.of(), otf.state), otf), None

    start = np.zeros(otf.grid.shape)
    return np.asarray(jax.lax.scan(add, start, (np.asarray(offsets), np.asarray(weights)))[0])


def along(length: float, angle: float, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of a drift at Gauss and Legendre's times, and their shares."""
    t, weights = np.polynomial.legendre.leggauss(nodes)
    turn = np.radians(angle)
    return length / 2 * np.outer(t, [np.cos(turn), np.sin(turn)]), weights / 2


def motion(angle: float, position: Callable[[np.ndarray], np.ndarray], nodes: int = 400):
    """Places along a line as a function of the time from -1/2 to 1/2, about their mean, and their shares."""
    t, weights = np.polynomial.legendre.leggauss(nodes)
    line = position(t / 2)
    turn = np.radians(angle)
    return np.outer(line - line @ weights / 2, [np.cos(turn), np.sin(turn)]), weights / 2


def normal(major: float, minor: float, angle: float, nodes: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Places of a normal blur at Gauss and Hermite's nodes, and their shares."""
    t, weights = np.polynomial.hermite_e.hermegauss(nodes)
    u, v = (g.ravel() for g in np.meshgrid(major * t, minor * t))
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.stack([c * u - s * v, s * u + c * v], axis=1), np.outer(weights, weights).ravel() / (2 * np.pi)


def direct(instrument: Instrument, state, scene: Scene) -> np.ndarray:
    """Stars by Fraunhofer's integral: every ray of the pupil summed at Gauss' nodes in every pixel."""
    stars = zip(*map(np.atleast_1d, map(np.asarray, scene.sources())), strict=True)
    return sum(_star(instrument, state, *star) for star in stars)


def _star(instrument: Instrument, state, x: float, y: float, flux: float, order: int = 5) -> np.ndarray:
    pupil, (ny, nx), scale = instrument.pupil, instrument.shape, instrument.plate_scale
    nodes, shares = np.polynomial.legendre.leggauss(order)
    metres = pupil.pitch * (np.arange(len(pupil.opd)) - (len(pupil.opd) - 1) / 2)
    rows, columns = (
        ((np.arange(n) - (n - 1) / 2)[:, None] * scale + scale / 2 * nodes).ravel() for n in (ny, nx)
    )
    opd = np.asarray(pupil.opd) + np.tensordot(state, np.asarray(pupil.basis), 1)
    light, image = float(pupil.light), 0.0
    for wavelength, weight in zip(instrument.spectrum.wavelengths, instrument.spectrum.weights, strict=True):
        wave = 2 * np.pi / (wavelength * 1e-9)
        field = np.asarray(pupil.transmission) * np.exp(1j * wave * 1e-9 * opd)
        up = np.exp(-1j * wave * ARCSEC * np.outer(rows - y, metres))
        across = np.exp(-1j * wave * ARCSEC * np.outer(metres, columns - x))
        area = (wave * pupil.pitch * scale * ARCSEC / (2 * np.pi)) ** 2 / light
        image = image + flux * weight * area * np.abs(up @ field @ across) ** 2
    share = np.tile(shares / 2, max(ny, nx))
    weighted = share[: ny * order, None] * image * share[: nx * order]
    return weighted.reshape(ny, order, nx, order).sum(axis=(1, 3))
