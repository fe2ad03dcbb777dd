"""The way to any instrument: by name or by file."""

from __future__ import annotations

from pathlib import Path

from jitterkit.instruments.instrument import Instrument
from jitterkit.instruments.presets import preset
from jitterkit.instruments.toml import read_instrument


def load_instrument(name_or_path: str | Path) -> Instrument:
    """Load an instrument.

    Parameters
    ----------
    name_or_path : str or Path
        A name in :data:`~jitterkit.instruments.presets.PRESETS`, or an instrument file (see
        :mod:`jitterkit.instruments.toml`): what ends in ``.toml`` or contains a directory is a file.

    Returns
    -------
    instrument : Instrument

    Raises
    ------
    ConfigurationError
        If there is no such preset or file, or the file cannot be used.
    """
    path = Path(name_or_path)
    is_file = path.suffix.lower() == ".toml" or len(path.parts) > 1
    return read_instrument(path) if is_file else preset(str(name_or_path))
