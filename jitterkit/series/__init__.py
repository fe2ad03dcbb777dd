"""A series of measurements of one number: how it averages, what it does meanwhile, what does not belong."""

from jitterkit.series.allan import AllanDeviation, BlockScatter, allan_deviation, block_scatter
from jitterkit.series.floor import Floor, fit_floor
from jitterkit.series.laws import (
    NOISES,
    degrees_of_freedom,
    difference_correlation,
    difference_variance,
    simulate_flicker,
)
from jitterkit.series.outliers import Outliers, find_outliers
from jitterkit.series.series import Series
from jitterkit.series.trend import Period, Trend, find_period, fit_trend
