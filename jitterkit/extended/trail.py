"""The blur from the trails that stars, or any points of light, have left.

A trail longer than some eight pixels is seen as such: its moments along and across its axis differ by
``L²/12``, whatever the PSF.  Every trail of a frame has the same length and angle but that of a satellite,
so the trails vote, and a lone dissenter is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.spectrum import apart, check_image, streak_estimate
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.vision import box_mean, components

_THRESHOLD = 3.0
"""Standard deviations of the image averaged over 3 x 3 pixels."""

_GATE = 8.0
"""Pixels: shorter trails are not distinguished from a PSF that is not round."""

_ELONGATION = 4.0
"""Least ratio of the variances along and across a trail."""

_LEAST_AREA = 20
"""Pixels: a trail of 8 by 2.5."""

_MARGIN = 3
"""Pixels about a trail's box: the wings of its PSF, below the threshold, belong to it."""

_TOLERANCE = 0.08
"""Of the length: ends of trails that lie closer belong to the same motion."""

_LEAST_ERROR = 0.05
"""Pixels: of one trail; the sampling of its ends."""


@dataclass(frozen=True)
class Trail:
    """One smeared point.

    Attributes
    ----------
    x, y : float
        Its middle, pixels.
    length, angle : float
        Pixels; degrees counter-clockwise from +x.
    along, across : float
        Standard errors of its end along and across it, pixels.
    """

    x: float
    y: float
    length: float
    angle: float
    along: float
    across: float


def estimate_trail(image: np.ndarray, *, plate_scale: float = 1.0) -> KernelEstimate:
    """Estimate a uniform streak from the trails in an image.

    Parameters
    ----------
    image : (ny, nx) array
        Points of light on a flat background.
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.

    Returns
    -------
    estimate : KernelEstimate

    Raises
    ------
    UndeterminedError
        If there is no trail of 8 pixels or more, or no majority of them agrees.

    Notes
    -----
    *Assumes* uniform motion along a line.  *Fails when* most trails overlap or leave the frame.
    """
    trails = find_trails(image)
    if not trails:
        problem = f"The image shows no trail of {_GATE:g} pixels or more away from its borders."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    length, angle = np.array([(trail.length, trail.angle) for trail in trails]).T
    ends = apart(length[:, None], angle[:, None], length, angle)
    near = ends < np.maximum(1.0, _TOLERANCE * length)[:, None]
    most = near.sum(axis=1)
    if 2 * most.max() <= len(trails):
        alike = f"those of one length and angle are {most.max()} at most"
        raise UndeterminedError(ErrorCode.AMBIGUOUS, f"The image's {len(trails)} trails disagree: {alike}.")
    alike_trails = [trail for trail, agrees in zip(trails, near[most.argmax()], strict=True) if agrees]
    first = alike_trails[0]
    turn = [np.radians((t.angle - first.angle + 90) % 180 - 90) * t.length for t in alike_trails]
    mean, along = _weighted([t.length for t in alike_trails], [t.along for t in alike_trails])
    off, across = _weighted(turn, [t.across for t in alike_trails])
    axis = first.angle + float(np.degrees(off / mean))
    return streak_estimate(mean, axis, "trail", (along, across), plate_scale)


def find_trails(image: np.ndarray) -> list[Trail]:
    """Find and measure the trails in an image; those that touch its borders are left out."""
    pixels = np.asarray(image)
    check_image(pixels)
    pixels = pixels.astype(float)
    pixels -= np.median(pixels)
    noise = 1.4826 * float(np.median(np.abs(pixels)))
    if noise == 0:  # a background without noise: whatever light there is stands out
        noise = 1e-6 * float(np.abs(pixels).max())
    parts = components(box_mean(pixels, 3) > _THRESHOLD * noise / 3)
    found = []
    for label, (area, box) in enumerate(zip(parts.area, parts.box, strict=True), start=1):
        x, y, nx, ny = (int(v) for v in box)
        left, low, right, high = x - _MARGIN, y - _MARGIN, x + nx + _MARGIN, y + ny + _MARGIN
        if area < _LEAST_AREA or min(left, low) < 0 or right > pixels.shape[1] or high > pixels.shape[0]:
            continue
        cut = np.s_[low:high, left:right]
        own = (parts.labels[cut] == label).astype(float)
        reach = box_mean(own, 2 * _MARGIN + 1) > 0
        others = (parts.labels[cut] != 0) & (own == 0)
        trail = _measure(pixels[cut], reach & ~others, noise, left, low)
        if trail is not None:
            found.append(trail)
    return found


def _measure(pixels: np.ndarray, chosen: np.ndarray, noise: float, left: int, low: int) -> Trail | None:
    """Measure one trail by the moments of its chosen pixels, or find that it is none."""
    rows, columns = np.nonzero(chosen)
    light = pixels[chosen]
    flux = light.sum()
    if not flux > 0:
        return None
    x, y = light @ columns / flux, light @ rows / flux
    dx, dy = columns - x, rows - y
    _values, vectors = np.linalg.eigh(np.cov(np.stack([dx, dy]), aweights=np.maximum(light, 0), ddof=0))
    c, s = vectors[:, 1]
    t, u = c * dx + s * dy, c * dy - s * dx
    along, across, tilt = light @ t**2 / flux, light @ u**2 / flux, light @ (t * u) / flux
    if not (across > 0 and along > _ELONGATION * across):
        return None
    length = float(np.sqrt(12 * (along - across)))
    if length < _GATE:
        return None
    # L² = 12 (along - across); the angle's tilt is the cross moment over their difference
    error = 6 / length * noise / flux * np.linalg.norm(t**2 - u**2 - along + across)
    turn = length * noise / flux * np.linalg.norm(t * u - tilt) / (along - across)
    angle = axis_angle(float(np.degrees(np.arctan2(s, c) + tilt / (along - across))))
    return Trail(
        x + left, y + low, length, angle, max(float(error), _LEAST_ERROR), max(float(turn), _LEAST_ERROR)
    )


def _weighted(values: list[float], errors: list[float]) -> tuple[float, float]:
    """Return the weighted mean and its error, which grows where values scatter more than they should."""
    value, weight = np.asarray(values), 1 / np.square(errors)
    mean = float(weight @ value / weight.sum())
    scatter = weight @ (value - mean) ** 2 / max(len(value) - 1, 1)
    return mean, float(np.sqrt(max(1.0, scatter) / weight.sum()))
