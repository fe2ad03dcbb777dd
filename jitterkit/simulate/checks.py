"""Scenes: read from a table of stars, and refused before any work where they cannot be simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.instruments.background_stars import read_star_table
from jitterkit.loci import Locus, locus_name, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.scene import Scene, Stars


def check_scene(scene: Scene, locus: Locus, background: float = 0.0) -> None:
    """Refuse what cannot be.

    Raises
    ------
    ConfigurationError
        With the value and what is possible.
    """
    rules = {
        "separation": (0.0, "must not be negative, in arcsec"),
        "flux": (np.nextafter(0, 1), "must be positive, in electrons per frame"),
        "contrast": (1.0, "must be at least one: A is the brighter star"),
        "background": (0.0, "must not be negative, in electrons per pixel"),
    }
    values = scene.values
    for name, value in {
        **values,
        "jitter": float(locus.coords.sum()),
        "background": float(background),
    }.items():
        least, rule = rules.get(name, (-np.inf, ""))
        if rule and not least <= value < np.inf:
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{name} = {value:g} {rule}.")
        if not np.isfinite(value):
            problem = f"{name} = {value:g} is not a finite number; give one."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)


def check_inside(scene: Scene, shape: tuple[int, int], plate_scale: float) -> None:
    """Refuse stars outside of a frame (ny, nx): what it would tell of them is next to nothing.

    Raises
    ------
    ConfigurationError
    """
    x, y, _ = np.abs(np.array(scene.sources()))
    for axis, positions, n in (("x", x, shape[1]), ("y", y, shape[0])):
        if np.max(positions) > n / 2 * plate_scale:
            problem = f"A star {np.max(positions):g} arcsec from the centre along {axis} is outside of the"
            reach = f"frame, which reaches {n / 2 * plate_scale:g} arcsec"
            remedy = "change --separation, --x or --y, or the table that lists it"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem} {reach}; {remedy}.")


def check_reach(scene: Scene, locus: Locus, otf: OTF) -> None:
    """Refuse stars so far out, or a blur so wide, that the image would not be exact.

    Light would wrap around the padded grid, or the locus is not computed so far.

    Raises
    ------
    ConfigurationError
    """
    grid = otf.grid
    major, _, _ = principal_axes(locus.moments())
    sources = np.abs(np.array(scene.sources()[:2]))
    for axis, star, n in zip("xy", sources, grid.shape[::-1], strict=True):
        limit = (n / 2 + grid.pad) * grid.plate_scale
        if star.max() + 2 * major > limit:
            star_and_blur = f"{star.max():g} arcsec from the centre along {axis}, with a blur of {major:g}"
            field = f"arcsec rms, leaves the modelled field of {limit:g} arcsec on each side"
            problem = f"A star {star_and_blur} {field}; move it in, or give more padding."
            raise ConfigurationError(ErrorCode.SAMPLING, problem)
    # the highest frequency [cycles/arcsec] that passes the optics with a hundredth's contrast
    fy, fx = grid.frequencies
    finest = float(np.hypot(fy, fx)[np.abs(np.asarray(otf.value)) > 0.01].max(initial=0.0))
    if locus.exact_to() < finest:
        raise ConfigurationError(
            ErrorCode.SAMPLING,
            f"A {locus_name(locus)} jitter of {major:.3g} arcsec rms is exact to {locus.exact_to():.3g} "
            f"cycles/arcsec only, and the telescope shows {finest:.3g}; take a smaller one, a trace of more "
            "samples, or a locus that has a formula: linear, shm, mvn or ellipse.",
        )


_UNITS = {"x": "arcsec", "y": "arcsec", "flux": "electron"}


def read_stars(path: str | Path) -> Stars:
    """Read the stars of a scene from a table.

    Parameters
    ----------
    path : str or Path
        ECSV or CSV with the columns ``x``, ``y`` (offsets from the frame's centre; arcsec unless the table
        says otherwise) and ``flux`` (electrons per frame).

    Returns
    -------
    stars : Stars

    Raises
    ------
    FrameError
        If the file cannot be read as such a table, or holds what no star can have.
    """
    x, y, flux = read_star_table(path, _UNITS)
    if np.any(flux <= 0):
        problem = "holds a star without light"
        raise FrameError(ErrorCode.OUT_OF_RANGE, path, problem, "give positive fluxes")
    return Stars.of(x, y, flux)
