"""What no frame can show, however well a model of it fits."""

from __future__ import annotations

import numpy as np

from jitterkit.forward import Parameters
from jitterkit.loci import principal_axes

__all__ = ["absurdity"]


def absurdity(parameters: Parameters, shape: tuple[int, int], plate_scale: float) -> str:
    """Say what is absurd about a fitted frame.

    Parameters
    ----------
    parameters : Parameters
    shape : (int, int)
        ``(ny, nx)`` of the frame.
    plate_scale : float
        arcsec/pixel.

    Returns
    -------
    problem : str
        Stars outside the frame, or a blur as wide as it is: half a sentence.  Empty if all is well.
    """
    half = (np.array(shape[::-1]) - 1) / 2 * plate_scale
    x, y, _ = map(np.asarray, parameters.scene.sources())
    middle = np.abs(np.array([float(parameters.scene.x), float(parameters.scene.y)]))
    if not np.all(middle <= half) or np.hypot(np.ptp(x), np.ptp(y)) > 2 * np.hypot(*half):
        return "it puts the stars outside the frame"
    major, _, _ = principal_axes(parameters.locus.moments())
    if 4 * major > 2 * half.max():
        return f"it blurs them by {major:.3g} arcsec rms, a quarter of the frame"
    return ""
