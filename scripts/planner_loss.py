"""What settings do to the separation of one frame, by brute force: fits of the frame without noise."""

from __future__ import annotations

import math

from jitterkit.errors import JitterkitError
from jitterkit.refit import FitResult, Status
from jitterkit.trade import Settings, TradeScene
from jitterkit.trade.grid import without_noise
from jitterkit.trade.predict import Example

__all__ = ["bias_of", "fitted", "loss"]


def loss(settings: Settings, example: Example, scene: TradeScene, whole: float) -> float:
    """Bias of the frame without noise, and the scatter that its region adds to its error, by a fit [arcsec].

    Infinite where the fit shows that the model does not describe the frame.

    Parameters
    ----------
    settings : Settings
    example : Example
        The first frame of the scene.
    scene : TradeScene
    whole : float
        Error of the separation with the instrument's own settings [arcsec].
    """
    found = fitted(settings, example, scene)
    if not found.status.usable or found.chi2 > math.sqrt(2 * found.dof):
        return math.inf
    lost = 0.0 if settings.region is None else found.error("separation") ** 2 - whole**2
    return math.hypot(bias_of(found, scene), math.sqrt(max(lost, 0.0)))


def bias_of(found: FitResult, scene: TradeScene) -> float:
    """What is wrong with the separation of the first frame of a scene [arcsec]."""
    return found.of_scene("separation") - float(scene.truths[0].binary.separation)


def fitted(settings: Settings, example: Example, scene: TradeScene) -> FitResult:
    """The fit of the frame without noise."""
    processor = settings.applied(example.processor)
    try:
        frame = without_noise(processor.calibrate(scene.plain[0]), scene.images[0])
    except JitterkitError as error:  # nothing is seen in so small a region
        return FitResult.from_error(Status.NO_STAR, error)
    return processor.complete(frame).result
