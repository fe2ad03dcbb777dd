"""Many frames: each processed on its own, all bound into a table, a summary and a report."""

from jitterkit.batch.finder import Finder
from jitterkit.batch.frame import Processed, Processor
from jitterkit.batch.run import Run, process_files
from jitterkit.batch.sequence import FileExposures

__all__ = ["FileExposures", "Finder", "Processed", "Processor", "Run", "process_files"]
