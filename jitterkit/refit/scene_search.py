"""The search for a scene in a frame whose model has errors."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import ModelError, Residual, allow_for_model
from jitterkit.optics.otf import OTF
from jitterkit.refit.weigh_scenes import SceneChoice

__all__ = ["found_allowing"]

Found = TypeVar("Found", covariant=True)
"""What a search returns that finds no scene."""


class Search(Protocol[Found]):
    """Find the scene of data, or say why not; a rough search leaves the last steps to a fit."""

    def __call__(self, data: Data, *, rough: bool) -> SceneChoice | Found: ...


def found_allowing(
    search: Search[Found], data: Data, otf: OTF, error: ModelError, *, rough: bool
) -> tuple[SceneChoice | Found, Data]:
    """Search for a scene, and again with the model error that the first shows.

    Parameters
    ----------
    search : callable
    data : Data
    otf : OTF
        Nominal, of the frame.
    error : float or "auto"
        As for :func:`~jitterkit.locate.allow_for_model`.
    rough : bool
        Whether to leave the last steps to a fit.

    Returns
    -------
    found : SceneChoice, or what else the search returns
    data : Data
        Without pixels that no star can have made, which a search would take for stars; with a variance for
        the model error.

    Notes
    -----
    The first search takes speckles for stars, if anything, so that no star is hidden in the error that it
    shows; the second allows for them.
    """
    if np.any(data.used):
        data = data.without(Residual.of_dark(data, otf).outliers(0.0, surely=True))
    if not error:
        return search(data, rough=rough), data
    first = search(data, rough=False)
    if not isinstance(first, SceneChoice):
        return first, data
    p, otf = first.start.parameters, first.start.otf
    allowed = allow_for_model(data, p, np.asarray(expected_image(p, otf)), otf, error)
    if allowed.model_variance is None:
        return first, data
    again = search(allowed, rough=rough)
    return (again if isinstance(again, SceneChoice) else first), allowed
