"""``jitterkit forecast``: the errors of frames that have not been taken."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, parse_sizes
from jitterkit.cli.pair import OF_PAIRS, pair_before, refuse_unused
from jitterkit.cli.products import check_products, deliver
from jitterkit.cli.quantities import parse_allowed, parse_angle, parse_sweeps
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["forecast"]

_DETECTOR = ("gain", "read_noise", "full_well")
"""Numbers of the detector that may be swept."""

_SCENE = ("separation", "theta", "x", "y", "flux", "contrast")


_SCENES = {"star": (*OF_PAIRS, "sweep", "allow"), "binary": ()}
"""Scenes, and the options that each has no use for: sweeps and allowances are about the separation."""


def forecast(
    context: typer.Context,
    instrument: options.InstrumentName = "toliman",
    locus: options.LocusName = "stable",
    length: options.Length = None,
    sigma: options.Sigma = None,
    shear: options.Shear = None,
    angle: options.Angle = None,
    sizes: options.Sizes = None,
    scene: Annotated[
        str, typer.Option(metavar="star|binary", help="One star, at --x and --y, or a pair.")
    ] = "binary",
    separation: options.Separation = 10.0,
    theta: options.Theta = 180.0,
    x: options.MiddleX = 0.0,
    y: options.MiddleY = 0.0,
    flux: options.Flux = None,
    contrast: options.Contrast = 3.37,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=FROM:TO:COUNT",
            help="Forecast a range of any size, scene parameter, aberration [nm], gain, read_noise or "
            "full_well; twice for a grid. NAME=a,b,c takes values as they are, FROM:TO:COUNT:log equal "
            "ratios.",
            show_default=False,
        ),
    ] = None,
    target: Annotated[
        str, typer.Option(metavar="ANGLE", help="Error of the mean separation to count frames and time for.")
    ] = "1uas",
    allow: Annotated[
        str | None,
        typer.Option(
            metavar="10%|1uas",
            help="Ask the other way round: how much jitter of each kind costs so much more observing time, "
            "or biases the separation by so much where it is fitted with --fitted.",
            show_default=False,
        ),
    ] = None,
    fitted: Annotated[
        str, typer.Option(metavar="LOCUS", help="What the frames are fitted with, for --allow with a bias.")
    ] = "mvn",
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Draw it: matrices of one forecast, curves of a sweep, the largest vibration of --allow.",
            show_default=False,
        ),
    ] = None,
    output: options.TableOutput = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Forecast errors, frames and time from the expected Fisher information.

    Prints the least standard error of every parameter of one frame (the Cramer-Rao bound), how far not
    knowing the others inflates it, and its correlation with the separation's; with --sweep a row a setting;
    with --allow a row a motion, at 0, 45 and 90 degrees from the pair. The detector's noise and saturated
    pixels are counted.
    """
    check_products(plot, output, overwrite)
    sweeps, goal = parse_sweeps(sweep or []), parse_angle(target, "--target")
    given = {"length": length, "sigma_major": sigma, "shear": shear, "angle": angle}
    given = {name: value for name, value in given.items() if value is not None} | parse_sizes(sizes or [])
    refuse_unused(scene, _SCENES, context)
    if allow is not None:
        _check_question(locus, given, sweeps)
    prepare_jax()
    from jitterkit.instruments import load_instrument

    telescope = load_instrument(instrument)
    pair = {"separation": separation, "theta": theta, "contrast": contrast} if scene == "binary" else {}
    setup = _Setup(telescope, locus, given, pair_before(telescope, flux, x=x, y=y, **pair))
    if allow is not None:
        table, draw = _ask_requirement(setup, allow, fitted)
    elif sweeps:
        table, draw = _ask_sweep(setup, sweeps, goal)
    elif scene == "star":
        table, draw = _ask_one_star(setup)
    else:
        table, draw = _ask_one(setup, goal)
    deliver(table, lambda: draw().axes[0], plot, output, overwrite)


def _check_question(locus: str, sizes: dict[str, Any], sweeps: dict[str, list[float]]) -> None:
    """Refuse what --allow does not ask about: it asks about every jitter."""
    from jitterkit.errors import ConfigurationError, ErrorCode

    if sweeps:
        raise ConfigurationError(
            ErrorCode.CONFLICT, "--allow and --sweep are two questions; ask them one at a time."
        )
    if locus != "stable" or sizes:
        raise ConfigurationError(
            ErrorCode.CONFLICT, f"--allow asks about every jitter; leave out --locus {locus} and its sizes."
        )


class _Setup:
    """A telescope, a scene and a jitter, of which any number may be changed by name."""

    def __init__(self, telescope, locus: str, sizes: dict[str, Any], scene: dict[str, float]) -> None:
        from jitterkit.refit import FitOptions, Priors

        self.telescope, self.locus, self.sizes, self.scene = telescope, locus, sizes, scene
        self.optics = telescope.system()
        self._still: dict[tuple[tuple[str, float], ...], float] = {}
        known = Priors.alike(telescope.aberrations, telescope.aberration_sigma)
        self.options = FitOptions(priors=known)

    def point(self, still: bool = False, censored: bool = False, **changes: float):
        """The forecast with some settings changed; those of a ``still`` telescope without its jitter."""
        import numpy as np

        from jitterkit.errors import ConfigurationError, ErrorCode
        from jitterkit.forecast import forecast
        from jitterkit.forward import Parameters
        from jitterkit.loci import Stable
        from jitterkit.scene import Binary, Star
        from jitterkit.simulate import check_reach, check_scene

        scene = {name: changes.pop(name, value) for name, value in self.scene.items()}
        state = np.array([changes.pop(name, 0.0) for name in self.telescope.aberrations])
        detector = self._detector({name: changes.pop(name) for name in _DETECTOR if name in changes})
        jitter = Stable.of() if still else build_locus(self.locus, {**self.sizes, **changes})
        stars = Binary(**scene) if "separation" in scene else Star(**scene)
        parameters, otf = Parameters(stars, jitter, state), self.otf(state)
        check_scene(stars, jitter)
        check_reach(stars, jitter, otf)
        exposure = self.telescope.exposure or 0.0
        found = forecast(parameters, otf, detector, self.options, exposure=exposure, censored=censored)
        if not np.all(np.isfinite(found.covariance)):
            raise ConfigurationError(
                ErrorCode.NOT_CONSTRAINED,
                f"A frame of {', '.join(f'{name} {value:g}' for name, value in scene.items())} does not "
                f"determine its parameters ({found.masked} pixels saturate); change flux, contrast or locus.",
            )
        return found

    def still(self, changes: dict[str, float]) -> float:
        """Error of the separation without jitter, at the same scene, optics and detector."""
        known = {*_SCENE, *_DETECTOR, *self.telescope.aberrations}
        beside = tuple((name, value) for name, value in changes.items() if name in known)
        if beside not in self._still:  # where the jitter alone is swept there is one
            self._still[beside] = self.point(still=True, censored=False, **dict(beside)).error("separation")
        return self._still[beside]

    def otf(self, state):
        """The optics at aberrations [nm]; those without are computed once."""
        return self.optics.otf(state) if state.any() else self.optics.nominal

    def _detector(self, changes: dict[str, float]):
        from dataclasses import replace

        return replace(self.telescope.detector, **changes) if changes else self.telescope.detector


def _ask_one_star(setup: _Setup):
    from jitterkit.report.forecast_table import parameter_table
    from jitterkit.report.matrix_plots import plot_matrices
    from jitterkit.report.words import angle_size

    found = setup.point()
    say(f"place: {angle_size(found.error('x'))} along x and {angle_size(found.error('y'))} along y, a frame.")
    if found.masked:
        say(f"{found.masked} pixels saturate, or come near it, and are left out.")
    return parameter_table(found), lambda: plot_matrices(found)


def _ask_one(setup: _Setup, goal: float):
    from jitterkit.forecast import degenerate_directions
    from jitterkit.report.forecast_table import parameter_table
    from jitterkit.report.matrix_plots import plot_matrices
    from jitterkit.report.words import angle_size, number

    found, still = setup.point(), setup.point(still=True)
    error, frames = found.error("separation"), found.frames(goal)
    exposure, goal_words = setup.telescope.exposure, angle_size(goal, 2).replace(".0 ", " ")
    time = (
        "" if exposure is None else f", {number(frames * exposure / 3600, 3)} h of {exposure:g} s exposures"
    )
    say(f"separation: {angle_size(error)} a frame; {goal_words} takes {frames:,.0f} frames{time}.")
    if setup.locus != "stable":
        more = 100 * ((error / still.error("separation")) ** 2 - 1)
        alone = angle_size(still.error("separation"))
        say(f"The jitter costs {number(more, 3)} % more time than none ({alone}).")
    if found.masked:
        counted = angle_size(setup.point(censored=True).error("separation"))
        say(
            f"{found.masked} pixels saturate, or come near it, and are left out; counted as full, by "
            f"--censored of process, they would make it {counted}."
        )
    for direction in degenerate_directions(found):
        share = (
            f"; {100 * direction.share:.0f} % of the separation's variance" if direction.share > 0.05 else ""
        )
        say(f"degenerate: {direction}{share}.")
    return parameter_table(found), lambda: plot_matrices(found)


def _ask_sweep(setup: _Setup, sweeps: dict[str, list[float]], goal: float):
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


def _ask_requirement(setup: _Setup, allow: str, fitted: str):
    from jitterkit.forecast import jitter_requirements
    from jitterkit.report.forecast_plots import plot_requirements
    from jitterkit.report.forecast_table import requirement_table

    question, allowed = parse_allowed(allow)
    bias = question == "bias"
    still = setup.point(still=True)
    found = jitter_requirements(
        still.parameters,
        setup.optics.nominal,
        allowed,
        setup.telescope.detector,
        fitted=fitted if bias else None,
        options=setup.options,
    )
    title = f"{allow} of bias, fitted with {fitted}" if bias else f"{allow} more observing time"
    say(f"Largest jitter for {title}; angles from the pair, vibrations by their cycles in an exposure.")
    exposure = setup.telescope.exposure
    return requirement_table(
        found, exposure
    ), lambda: plot_requirements(found, exposure=exposure, title=title).figure
