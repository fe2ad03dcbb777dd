"""A pair of stars before a telescope, as the commands that forecast have it."""

from __future__ import annotations

__all__ = ["pair_before"]


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
