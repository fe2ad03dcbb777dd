"""``python -m jitterkit`` is the command ``jitterkit``."""

from jitterkit.cli.main import run

run()
