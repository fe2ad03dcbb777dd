"""The transfer functions of blurs that are fitted between two frames, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import j0, j1

Slopes = Callable[[], list[np.ndarray]]
"""Computes the derivatives of a transfer function by its parameters."""

Transfer = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, Slopes]]
"""The transfer function of parameters at frequencies (x, y) [cycles/pixel], and its derivatives."""


def normal(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a normal of moments ``q`` (sxx, sxy, syy), and its derivatives."""
    exponent = -2 * np.pi**2 * (q[0] * fx**2 + 2 * q[1] * fx * fy + q[2] * fy**2)
    transfer = np.exp(np.clip(exponent, -60, 2))  # a reference that is blurrier must not overflow

    def slopes() -> list[np.ndarray]:
        slope = -2 * np.pi**2 * transfer
        return [slope * fx**2, 2 * slope * fx * fy, slope * fy**2]

    return transfer, slopes


def streak(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a streak from ``-q/2`` to ``q/2`` (x, y), and its derivatives."""
    phase = q[0] * fx + q[1] * fy
    transfer = np.sinc(phase)

    def slopes() -> list[np.ndarray]:
        slope = _slope_of_sinc(phase)
        return [slope * fx, slope * fy]

    return transfer, slopes


def _slope_of_sinc(phase: np.ndarray) -> np.ndarray:
    small = np.abs(phase) < 1e-6
    return np.where(small, 0.0, (np.cos(np.pi * phase) - np.sinc(phase)) / np.where(small, 1.0, phase))


def drift(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a streak under a normal, and its derivatives.

    ``q`` is (sxx, sxy, syy) of both together [pixel²], and the streak from end to end (x, y) [pixels].
    """
    return _under_normal(np.sinc, _slope_of_sinc, 1 / 12, q, fx, fy)


def vibration(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a sine under a normal, and its derivatives: ``q`` as in `drift`."""
    return _under_normal(lambda u: j0(np.pi * u), lambda u: -np.pi * j1(np.pi * u), 1 / 8, q, fx, fy)


def _under_normal(form, slope, share, q, fx, fy) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a motion along ``q[3:]``, with a share of its square as variance."""
    phase = q[3] * fx + q[4] * fy
    exponent = q[0] * fx**2 + 2 * q[1] * fx * fy + q[2] * fy**2 - share * phase**2
    rest = np.exp(np.clip(-2 * np.pi**2 * exponent, -60, 2))
    transfer = form(phase) * rest

    def slopes() -> list[np.ndarray]:
        turn = -2 * np.pi**2 * transfer
        along = slope(phase) * rest - 2 * share * phase * turn
        return [turn * fx**2, 2 * turn * fx * fy, turn * fy**2, along * fx, along * fy]

    return transfer, slopes
