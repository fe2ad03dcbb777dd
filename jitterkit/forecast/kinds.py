"""Kinds of jitter by name, size and angle: reach for :func:`jitter_of_kind`."""

from __future__ import annotations

import inspect
from collections.abc import Callable

from jitterkit.conventions import FWHM_PER_SIGMA
from jitterkit.errors import ConfigurationError, ErrorCode, one_of, refuse_if
from jitterkit.loci import Ellipse, Linear, Locus, Mvn, PartialShm, Shm


def _mvn(size: float, angle: float, shear: float = 0.1) -> Locus:
    return Mvn.sheared(size / FWHM_PER_SIGMA, shear, angle)


def _ellipse(size: float, angle: float, ratio: float = 0.5) -> Locus:
    problem = f"ratio = {ratio:g} is not that of the minor axis over the major one; give 0 to 1."
    refuse_if(not 0 <= ratio <= 1, ErrorCode.OUT_OF_RANGE, problem)
    return Ellipse.of(size / 2, ratio * size / 2, angle)


def _partial(size: float, angle: float, cycles: float = 0.7, phase: float = 30.0) -> Locus:
    return PartialShm.of(size, angle, cycles, phase)


KINDS: dict[str, Callable[..., Locus]] = {
    "linear": Linear.of,
    "shm": Shm.of,
    "mvn": _mvn,
    "ellipse": _ellipse,
    "partial": _partial,
}


_GIVEN = ("size", "length", "angle")


def jitter_of_kind(kind: str, size: float, angle: float) -> Locus:
    """Make a jitter of a kind.

    Parameters
    ----------
    kind : str
        A name in :data:`KINDS`, and after commas what shapes it: ``"mvn,shear=0.7"``,
        ``"ellipse,ratio=0.3"``, ``"partial,cycles=0.7,phase=30"``.
    size : float
        arcsec.
    angle : float
        Degrees counter-clockwise from +x.

    Raises
    ------
    ConfigurationError
        If there is no such kind, or it is not shaped so.

    >>> jitter_of_kind("mvn,shear=0.5", 0.2355, 30.0).describe()["sigma_minor"].__round__(4)
    0.05
    """
    name, *settings = kind.split(",")
    build = KINDS[one_of("kind of jitter", name, KINDS)]
    shapes = [word for word in inspect.signature(build).parameters if word not in _GIVEN]
    try:
        shape = {word.strip(): float(value) for word, value in (s.split("=") for s in settings)}
    except ValueError:
        problem = f"{kind!r} is not understood; write mvn,shear=0.7."
        raise ConfigurationError(ErrorCode.MALFORMED, problem) from None
    foreign = [word for word in shape if word not in shapes]
    if foreign:
        may = f"it may have {', '.join(shapes)}" if shapes else "it has a size and an angle only"
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"The kind {name} has no {foreign[0]}; {may}.")
    return build(size, angle, **shape)
