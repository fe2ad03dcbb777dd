"""The public model's settings on our axes, against a refit of its own."""

import numpy as np
import pytest

from jitterkit.scene import Binary
from jitterkit.trade import public
from jitterkit.trade.public import public_image


@pytest.mark.slow
def test_the_bias_of_five_images_is_that_of_a_refit_with_the_public_model(monkeypatch):
    """``scripts/benchmark`` refits the frame of direct quadrature by the public model's own gradients."""
    pytest.importorskip("dLuxToliman")
    monkeypatch.setattr(public, "_SETTINGS", ((5, 4),))
    monkeypatch.setattr(public, "_ANGLES", (25.0,))
    (point,) = public.public_points(Binary(10.0, 180.0, 0.0, 0.0, 3.811e7, 3.37), 0.375)
    assert point.bias == pytest.approx(42.1e-6, rel=0.02)
    assert point.sigma == pytest.approx(271e-6, rel=0.01)
    assert point.seconds > 0


@pytest.mark.slow
def test_x_and_y_of_the_public_image_are_ours():
    pytest.importorskip("dLuxToliman")
    image = public_image(images=2, samples=1)
    vector = np.array([10.0, 90.0, 0.0, 0.0, 7.0, 3.37, *np.zeros(7), 0.0, 0.0])
    moved = vector + np.array([0.0, 0.0, 3 * 0.375, -2 * 0.375, *np.zeros(11)])
    still, moved = (np.asarray(image(v)) for v in (vector, moved))
    expected = np.roll(still, (-2, 3), axis=(0, 1))  # rows grow with y
    inner = slice(8, -8)
    assert moved[inner, inner] == pytest.approx(expected[inner, inner], abs=1e-6 * still.max())
