"""The public model's settings on our axes, against a refit of its own."""

import pytest

from jitterkit.scene import Binary
from jitterkit.trade import public


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
