"""Forecast the errors of frames that have not been taken: ``jitterkit forecast``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, size_option
from jitterkit.cli.quantities import parse_allowed, parse_angle, parse_sweeps
from jitterkit.cli.runtime import dark_exposure, log, open_instrument, print_table
from jitterkit.errors import ErrorCode, refuse_if
from jitterkit.report.words import angle_size, number

if TYPE_CHECKING:
    from jitterkit.forecast import Forecast

_DETECTOR = ("gain", "read_noise", "full_well")
"""Numbers of the detector that may be swept."""

_SCENE = ("separation", "theta", "x", "y", "flux", "contrast")

_SCENES = {
    "star": (*options.OF_PAIRS, "sweep", "allow", "target"),
    "binary": (),
    "stars": (*options.OF_PAIRS, "flux", "sweep", "allow", "target"),
}
"""Scenes, and options that each one does not use: sweeps, allowances and targets are of the separation."""


def forecast(
    context: typer.Context,
    *,
    instrument: options.InstrumentName = "toliman",
    jitter: options.Jitter,
    scene: str = "binary",
    stars: Path | None = None,
    pair: options.Pair,
    sweep: list[str] | None = None,
    target: str = "1uas",
    allow: str | None = None,
    fitted: str = "mvn",
    products: options.Products,
) -> None:
    """Forecast errors, frames and time from the expected Fisher information.

    Prints the least standard error of every parameter of one frame (the Cramer-Rao bound), how much it grows
    because the others are unknown, and its correlation with the separation's; with --sweep a row per setting;
    with --allow a row per motion, at 0, 45 and 90 degrees from the pair. The detector's noise and saturated
    pixels are counted.

    Parameters
    ----------
    scene : star|binary|stars
        One star, at --x and --y, a pair, or the stars of --stars, moved by --x and --y.
    stars : TABLE
        Table (ECSV or CSV) with columns x, y (arcsec from the centre) and flux (electrons): the stars of
        --scene stars, or further stars beside another scene.
    sweep : NAME=FROM:TO:COUNT
        Forecast a range of any size, scene parameter, aberration [nm], gain, read_noise or full_well; twice
        for a grid. NAME=a,b,c gives the values, FROM:TO:COUNT:log equal ratios.
    target : ANGLE
        Error of the mean separation for which frames and time are counted.
    allow : 10%|1uas
        Compute the reverse: how much jitter of each kind costs this much more observing time, or biases the
        separation by this much if it is fitted with --fitted.
    fitted : LOCUS
        Locus that is fitted, for --allow with a bias.
    plot : FILE.png
        Draw the matrices of one forecast, the curves of a sweep, or the largest vibration of --allow.
    """
    products.check()
    sweeps, goal, sizes = parse_sweeps(sweep or []), parse_angle(target, "--target"), jitter.size_values()
    options.check_scene_options(scene, stars, _SCENES, context)
    bias = allow is not None and parse_allowed(allow)[0] == "bias"
    options.refuse_given(context, () if bias else ("fitted",), "is for an --allow of bias, such as 1uas")
    if allow is not None:
        _check_allow(jitter.locus, sizes, sweeps)
        options.refuse_given(context, ("target",), "is not used with --allow")
    for name in sweeps:
        why = f"is replaced by --sweep {name}"
        refuse_if(name in sizes, ErrorCode.CONFLICT, f"{size_option(name)} {why}; leave it out.")
        options.refuse_given(context, [name] if name in _SCENE else [], why)
    telescope = open_instrument(instrument)

    setup = _Setup(telescope, jitter.locus, sizes, pair.of(scene, telescope), options.read_stars(stars))
    if allow is not None:
        table, draw = _forecast_requirement(setup, allow, fitted)
    elif sweeps:
        table, draw = _forecast_sweep(setup, sweeps, goal)
    else:
        table, draw = _forecast_frame(setup, goal)
    print_table(table)
    products.write(table, lambda: draw().axes[0])


def _check_allow(locus: str, sizes: dict[str, Any], sweeps: dict[str, list[float]]) -> None:
    """Refuse a sweep or a jitter beside --allow, which computes every jitter."""
    conflict = ErrorCode.CONFLICT
    refuse_if(sweeps != {}, conflict, "--allow and --sweep cannot be combined; give one of the two.")
    problem = f"--allow computes every jitter; leave out --locus {locus} and its sizes."
    refuse_if(locus != "stable" or sizes != {}, conflict, problem)


class _Setup:
    """Hold a telescope, a scene and a jitter, of which any number may be changed by name."""

    def __init__(self, telescope, locus: str, sizes: dict[str, Any], scene: dict[str, float], stars=None):
        from jitterkit.refit import FitOptions, Priors

        self.telescope, self.locus, self.sizes, self.scene, self.stars = telescope, locus, sizes, scene, stars
        self.optics = telescope.system()
        self._still: dict[tuple[tuple[str, float], ...], float] = {}
        known = Priors.alike(telescope.aberrations, telescope.aberration_sigma)
        self.options = FitOptions(priors=known)

    def point(self, still: bool = False, censored: bool = False, **changes: float):
        """Return the forecast with some settings changed; that of a ``still`` telescope has no jitter."""
        import numpy as np

        from jitterkit.forecast import forecast
        from jitterkit.forward import Parameters
        from jitterkit.loci import Stable
        from jitterkit.simulate import check_inside, check_reach, check_scene

        scene = {name: changes.pop(name, value) for name, value in self.scene.items()}
        state = np.array([changes.pop(name, 0.0) for name in self.telescope.aberrations])
        numbers = {name: float(changes.pop(name)) for name in _DETECTOR if name in changes}
        detector = replace(self.telescope.detector, **numbers) if numbers else self.telescope.detector
        jitter = Stable.of() if still else build_locus(self.locus, {**self.sizes, **changes})
        stars = options.sources(scene, self.stars)
        parameters, otf = Parameters(stars, jitter, state), self.otf(state)
        check_scene(stars, jitter)
        check_reach(stars, jitter, otf)
        check_inside(stars, self.telescope.shape, self.telescope.plate_scale)
        exposure = dark_exposure(self.telescope)
        found = forecast(parameters, otf, detector, self.options, exposure=exposure, censored=censored)
        known, shown = np.all(np.isfinite(found.covariance)), [f"{n} {value:g}" for n, value in scene.items()]
        shown += [] if self.stars is None else [f"{len(self.stars.sources()[0])} stars of a table"]
        problem = f"A frame of {', '.join(shown)} does not determine its parameters"
        remedy = f"({found.masked} pixels saturate); change flux, contrast or locus"
        refuse_if(not known, ErrorCode.NOT_CONSTRAINED, f"{problem} {remedy}.")
        return found

    def still(self, changes: dict[str, float]) -> float:
        """Return the error of the separation without jitter, for the same scene, optics and detector."""
        known = {*_SCENE, *_DETECTOR, *self.telescope.aberrations}
        beside = tuple((name, value) for name, value in changes.items() if name in known)
        if beside not in self._still:  # only one if the jitter alone is swept
            self._still[beside] = self.point(still=True, censored=False, **dict(beside)).error("separation")
        return self._still[beside]

    def otf(self, state):
        """Return the optics at aberrations [nm]; the optics without aberrations are computed once."""
        return self.optics.otf(state) if state.any() else self.optics.nominal


def _forecast_frame(setup: _Setup, goal: float):
    from jitterkit.report.forecast_plots import plot_matrices
    from jitterkit.report.forecast_table import parameter_table

    found = setup.point()
    if "separation" in setup.scene:
        _log_separation(setup, found, goal)
    else:
        _log_position(setup, found)
    return parameter_table(found), lambda: plot_matrices(found)


def _log_position(setup: _Setup, found: Forecast) -> None:
    x, y = angle_size(found.error("x")), angle_size(found.error("y"))
    brightest = "" if setup.stars is None else " of the brightest star"
    log(f"position{brightest} per frame: {x} along x and {y} along y.")
    if found.masked:
        log(f"{found.masked} pixels are at or near saturation and are excluded.")


def _log_separation(setup: _Setup, found: Forecast, goal: float) -> None:
    from jitterkit.forecast import degenerate_directions

    error, frames = found.error("separation"), found.frames(goal)
    exposure, target, time = setup.telescope.exposure, angle_size(goal, 2).replace(".0 ", " "), ""
    if exposure is not None:
        time = f", {number(math.ceil(frames) * exposure / 3600, 3)} h of {exposure:g} s exposures"
    whole = f"{math.ceil(frames):,} frame{'s' * (frames > 1)}"  # 11.2 frames do not do with 11
    log(f"separation: {angle_size(error)} per frame; {target} takes {whole}{time}.")
    if setup.locus != "stable":
        still = setup.still({})
        more = number(100 * ((error / still) ** 2 - 1), 3)
        log(f"The jitter costs {more} % more time than no jitter ({angle_size(still)}).")
    if found.masked:
        counted = angle_size(setup.point(censored=True).error("separation"))
        excluded = f"{found.masked} pixels are at or near saturation and are excluded"
        log(f"{excluded}; treated as lower limits, by --censored of process, they would make it {counted}.")
    for direction in degenerate_directions(found):
        share = f"; {100 * direction.share:.0f} % of the separation's variance"
        log(f"degenerate: {direction}{share if direction.share > 0.05 else ''}.")


def _forecast_sweep(setup: _Setup, sweeps: dict[str, list[float]], goal: float):
    import numpy as np

    from jitterkit.forecast import sweep
    from jitterkit.report.forecast_plots import plot_errors
    from jitterkit.report.forecast_table import sweep_table

    grid = sweep(setup.point, sweeps)
    points = zip(*grid.points().values(), strict=True)
    still = [setup.still(dict(zip(grid.axes, point, strict=True))) for point in points]
    exposure, scale = setup.telescope.exposure, setup.telescope.plate_scale
    drawn = {"exposure": exposure, "target": goal, "title": setup.locus, "plate_scale": scale}
    same = max(still) - min(still) < 1e-9 * max(still)  # where the jitter alone is swept
    table = sweep_table(grid, np.reshape(still, grid.forecasts.shape), goal, exposure)
    return table, lambda: plot_errors(grid, still=still[0] if same else None, **drawn).figure


def _forecast_requirement(setup: _Setup, allow: str, fitted: str):
    from jitterkit.forecast import jitter_requirements
    from jitterkit.report.forecast_plots import plot_requirements
    from jitterkit.report.forecast_table import requirement_table

    question, allowed = parse_allowed(allow)
    bias, exposure = question == "bias", setup.telescope.exposure
    where = setup.point(still=True).parameters, setup.optics.nominal, allowed, setup.telescope.detector
    asked, dark = fitted if bias else None, dark_exposure(setup.telescope)
    found = jitter_requirements(*where, fitted=asked, options=setup.options, exposure=dark)
    title = f"{allow} of bias, fitted with {fitted}" if bias else f"{allow} more observing time"
    log(f"Largest jitter for {title}; angles from the pair, vibrations by their cycles in an exposure.")
    table = requirement_table(found, exposure)
    return table, lambda: plot_requirements(found, exposure=exposure, title=title).figure
