"""Many frames: each processed on its own, by threads or workers; results are yielded and stored."""

from jitterkit.batch.processor import FrameProcessor
from jitterkit.batch.records import ProcessedFrame
from jitterkit.batch.sequence import FileExposures
