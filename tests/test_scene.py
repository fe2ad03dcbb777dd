"""A scene in the parameters that a person would give is the same scene."""

import numpy as np
import pytest

from jitterkit.scene import Binary


def sources(scene):
    """Places and fluxes of the stars, whichever is called A."""
    return sorted(zip(*(np.asarray(one).tolist() for one in scene.sources()), strict=True))


@pytest.mark.parametrize(
    ("separation", "theta", "contrast", "named"),
    [
        (5.0, 30.0, 3.0, (5.0, 30.0, 3.0)),
        (5.0, 30.0, 0.25, (5.0, 210.0, 4.0)),
        (-5.0, 30.0, 3.0, (5.0, 210.0, 3.0)),
        (-5.0, 230.0, 0.5, (5.0, 230.0, 2.0)),
    ],
)
def test_the_brighter_star_is_a_and_the_separation_is_positive(separation, theta, contrast, named):
    scene = Binary(separation, theta, 0.3, -0.2, 1e5, contrast)
    tidied = scene.canonical()
    found = [float(getattr(tidied, name)) for name in ("separation", "theta", "contrast")]
    assert found == pytest.approx(named)
    for star, same in zip(sources(scene), sources(tidied), strict=True):
        assert same == pytest.approx(star, rel=1e-12)
