"""What accuracy costs: the settings that trade one for the other, measured on a scene."""

from jitterkit.trade.ladder import Point, climb_ladder, front
from jitterkit.trade.scenes import TradeScene
from jitterkit.trade.settings import PRESETS, Settings

__all__ = ["PRESETS", "Point", "Settings", "TradeScene", "climb_ladder", "front"]
