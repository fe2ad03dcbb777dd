"""What frames will tell before they are taken, and what a wrong model does to them.

Reach for :func:`forecast` first: the error of every parameter of one frame.  :func:`degenerate_directions`
says what it confuses, :func:`sweep` draws curves, :func:`jitter_requirements` asks how much jitter may be,
and :func:`noise_free_fit` what a wrong locus does.
"""

from jitterkit.forecast.bound import Forecast, expected_data, forecast
from jitterkit.forecast.crossfit import CrossFit, noise_free_fit
from jitterkit.forecast.directions import Direction, degenerate_directions
from jitterkit.forecast.ensemble import Draws, linearised_draws, refitted_draws
from jitterkit.forecast.requirement import Requirement, jitter_requirements, largest_size, one_step_bias
from jitterkit.forecast.sweep import Sweep, sweep

__all__ = [
    "CrossFit",
    "Direction",
    "Draws",
    "Forecast",
    "Requirement",
    "Sweep",
    "degenerate_directions",
    "expected_data",
    "forecast",
    "jitter_requirements",
    "largest_size",
    "linearised_draws",
    "noise_free_fit",
    "one_step_bias",
    "refitted_draws",
    "sweep",
]
