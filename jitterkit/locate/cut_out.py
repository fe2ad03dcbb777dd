"""Cut-outs about a pair: the smallest that tell enough of its blur.

A cut-out is periodic: light that leaves it on one side comes back on the other, so a rim is left out.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from scipy.fft import next_fast_len

from jitterkit.forward import Parameters
from jitterkit.metric import invert_information
from jitterkit.optics import OpticalSystem

_DEARER = 1.01
"""Factor by which the errors of the moments may grow, for the sake of a smaller cut-out."""

SPARE = 3
"""Pixels by which the pair may be off its position in the cut-out before light returns within the rim."""


def window(
    parameters: Parameters,
    roots: np.ndarray,
    known: np.ndarray,
    moments: list[int],
    system: OpticalSystem,
) -> tuple[np.ndarray, tuple[int, int], tuple[int, int]] | None:
    """First pixel, size and rim ``(y, x)`` of the smallest cut-out that tells enough of the blur.

    ``roots`` (p, ny, nx) are the image's derivatives in standard deviations of its pixels, ``known`` (p, p)
    is the information beside them.  None where no cut-out is smaller than the frame.
    """
    grid, scene, shape = system.grid, parameters.scene, np.array(roots.shape[1:])
    x, y, _ = scene.sources()
    middle = np.array([scene.y, scene.x]) / grid.plate_scale + (shape - 1) / 2
    reach = np.abs(np.array([y, x]) - np.array([[scene.y], [scene.x]])).max(axis=1) / grid.plate_scale
    rim_y, rim_x = (int(np.ceil(pixels)) + SPARE for pixels in reach)

    def errors(half: int) -> np.ndarray:  # the fewer pixels, the larger
        first, last = (np.clip(np.round(middle) + by, 0, shape).astype(int) for by in (-half, half))
        part = roots[:, first[0] : last[0], first[1] : last[1]].reshape(len(roots), -1).astype(float)
        return np.sqrt(np.diag(invert_information(part @ part.T + known)[0])[moments])

    most = int(shape.max())
    least = errors(most)
    half = 1 + bisect_left(range(1, most), True, key=lambda h: bool(np.all(errors(h) < _DEARER * least)))
    wanted = [2 * (half + rim) for rim in (rim_y, rim_x)]
    if grid.refine % 2 == 0 and any(fine % 2 for fine in grid.fine_shape):
        return None  # no cut-out has its centre where the frame has it
    sizes = zip(wanted, grid.fine_shape, strict=True)
    size = np.array([_fast(pixels, grid.refine, fine) for pixels, fine in sizes])
    about = np.round(middle).astype(int) - size // 2
    corner = np.clip(about, 0, shape - size)
    if np.any(size >= shape) or np.abs(corner - about).max() > SPARE:
        return None
    return corner, (int(size[0]), int(size[1])), (rim_y, rim_x)


def _fast(pixels: int, refine: int, fine: int) -> int:
    """Return the next size whose transform is fast, with an even or odd number of samples as ``fine`` is."""
    while next_fast_len(refine * pixels, real=True) != refine * pixels or (refine * pixels - fine) % 2:
        pixels += 1
    return pixels


def inner(corner, size, rim) -> tuple[slice, slice]:
    """Return the slices of a cut-out without its rim."""
    y, x = (slice(first + edge, first + n - edge) for first, n, edge in zip(corner, size, rim, strict=True))
    return y, x


def off_centre(corner, size, shape) -> np.ndarray:
    """Return the offset ``(y, x)`` [pixels] of a cut-out's centre from the frame's."""
    return corner + np.subtract(size, shape) / 2
