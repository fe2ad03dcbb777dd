"""What frames will tell before they are taken, and what a wrong model does to them.

Reach for :func:`forecast` first: the error of every parameter of one frame.  :func:`degenerate_directions`
says what it confuses, :func:`systematic_errors` what the model leaves out, :func:`sweep` draws curves,
:func:`jitter_requirements` asks how much jitter may be, and :func:`noise_free_fit` what a wrong locus does.
"""

from jitterkit.forecast.bound import Forecast, Sweep, expected_data, forecast, sweep
from jitterkit.forecast.crossfit import CrossFit, noise_free_fit
from jitterkit.forecast.directions import Direction, degenerate_directions
from jitterkit.forecast.kinds import KINDS, jitter_of_kind
from jitterkit.forecast.requirement import Requirement, jitter_requirements, largest_size, moment_bias
from jitterkit.forecast.study import Draws, Panel, cross_fit, linearised_draws
from jitterkit.forecast.systematics import SystematicError, systematic_errors
