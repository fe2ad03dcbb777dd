"""A pair of stars before a telescope, as the commands that forecast have it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import typer

__all__ = ["OF_PAIRS", "pair_before", "refuse_unused"]

OF_PAIRS = ("separation", "theta", "contrast")
"""Options that only a pair has a use for."""


def pair_before(telescope, flux: float | None, **scene: float) -> dict[str, float]:
    """The scene's parameters by name, with the instrument's usual flux where none is given.

    Raises
    ------
    ConfigurationError
        If nobody says the flux.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode

    photons = telescope.flux if flux is None else flux
    if photons is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE, f"The instrument {telescope.name!r} has no usual flux; give --flux."
        )
    return {**scene, "flux": photons}


def refuse_unused(scene: str, scenes: Mapping[str, Collection[str]], context: typer.Context) -> None:
    """Refuse an unknown scene, and options that were given and that it has no use for.

    Raises
    ------
    ConfigurationError
    """
    from jitterkit.errors import ConfigurationError, ErrorCode

    if scene not in scenes:
        raise ConfigurationError(
            ErrorCode.UNKNOWN_NAME, f"There is no scene {scene!r} here; give one of {', '.join(scenes)}."
        )
    for name in scenes[scene]:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise ConfigurationError(
                ErrorCode.CONFLICT, f"--scene {scene} has no use for --{name}; leave it out."
            )
