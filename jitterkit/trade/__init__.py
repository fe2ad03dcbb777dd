"""What accuracy costs: the settings that trade one for the other, measured on a scene."""

from jitterkit.trade.grid import front, measure_grid
from jitterkit.trade.scenes import TradeScene
from jitterkit.trade.settings import PRESETS, Settings
