"""Measured settings: their bias against linear theory, their bound, and the front."""

import math
import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.forecast import forecast
from jitterkit.forward import expected_image, free_parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import PartialShm
from jitterkit.report.table import read_table
from jitterkit.scene import Binary
from jitterkit.trade import PRESETS, Settings, TradeScene, front, grid, measure_grid
from jitterkit.trade.grid import Point
from jitterkit.trade.table import trade_table


def measure(*given):
    """The point alone."""
    return grid.measure(*given)[0]


def linear_biases(settings, plain, scene):
    """What one scoring step from the truth makes of the separation of exact images."""
    system, biases = settings.instrument(plain).system(), []
    for truth, image in zip(scene.truths, scene.images, strict=True):
        otf = system.otf(truth.aberrations)
        names, free = free_parameters(truth, otf)
        equations = normal_equations(truth, otf, Data(image, 9.0 + 4 / 12), free)
        step = np.linalg.solve(np.asarray(equations.information), np.asarray(equations.score))
        biases.append(step[names.index("separation")])
    return np.array(biases)


@pytest.mark.parametrize(
    "settings",
    [Settings(samples=2, aberrations="expanded"), Settings(binning=4, pad=8, aberrations="expanded")],
)
def test_a_bias_is_that_of_linear_theory(plain, scene, settings):
    expected = np.sqrt(np.mean(linear_biases(settings, plain, scene) ** 2))
    point = measure("one", settings, plain, scene)
    assert expected > 1e-5  # arcsec: there is something to compare
    assert point.bias == pytest.approx(expected, rel=0.1)


@pytest.mark.slow  # five grids and three kinds of nodes, each a program of its own
def test_few_nodes_fit_what_few_nodes_show(plain):
    """What only the integral over time gets wrong is gone where the image has the same wrong."""
    pair, jitter = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0), PartialShm.of(2.5, 20.0, 1.3, 30.0)
    scene = TradeScene.of(plain, pair, jitter, 1, np.random.default_rng(5))
    few = Settings(nodes=10, pad=128, samples=16, aberrations="expanded")
    system, images = few.instrument(plain).system(), []
    for truth in scene.truths:
        otf = system.otf(truth.aberrations, derivatives=False)
        images.append(np.asarray(expected_image(truth.with_locus(truth.locus.sampled(10)), otf)))
    coarse = replace(scene, images=tuple(images))
    seen = measure("seen", few, plain, coarse, "partial")
    # a regularized fit may leave a hundredth of the error (refit.fit); by rounding, 3e-4 or 1.5e-3
    assert seen.bias < 1e-2 * seen.sigma
    assert measure("exact", few, plain, scene, "partial").bias > 10 * seen.bias
    assert measure("own", replace(few, nodes=None), plain, coarse, "partial").bias > 10 * seen.bias


@pytest.mark.slow
def test_without_approximation_there_is_no_bias_and_the_error_is_the_bound(plain, scene):
    point = measure("exact", PRESETS["exact"], plain, scene)
    bounds = []
    for truth in scene.truths:
        otf = PRESETS["exact"].instrument(plain).system().otf(truth.aberrations)
        bounds.append(forecast(truth, otf, plain.detector, exposure=1.0).error("separation"))
    assert point.bias < 1e-4 * point.sigma
    assert point.sigma == pytest.approx(np.sqrt(np.mean(np.square(bounds))), rel=1e-3)
    assert point.error < 1e-3


@pytest.mark.slow
def test_a_smaller_region_scatters_more(plain, scene):
    """The information of light that is cut off is the difference of the estimates' variances."""
    whole, reference = grid.measure("whole", Settings(), plain, scene)
    part, found = grid.measure("part", Settings(region=24), plain, scene, "mvn", reference)
    assert whole.scatter == 0
    assert part.bound == whole.sigma
    assert part.sigma > 1.003 * whole.sigma
    expected = np.sqrt(part.sigma**2 - whole.sigma**2)
    assert 0.2 * expected < part.scatter < 2.5 * expected  # an rms of three
    assert part.scatter == pytest.approx(np.sqrt(np.mean((found.noisy - reference.noisy) ** 2)), rel=1e-3)


@pytest.mark.slow
def test_held_aberrations_bias(plain, scene):
    held = measure("held", Settings(aberrations="held"), plain, scene)
    free = measure("free", Settings(), plain, scene)
    assert held.bias > 10 * free.bias
    assert held.bias < held.sigma


@pytest.mark.slow
def test_thirty_two_bits_are_measured_beside_sixty_four(plain, scene):
    _, reference = grid.measure("64", Settings(), plain, scene)
    beside = measure("32", Settings(bits=32), plain, scene, "mvn", reference)
    assert beside.seconds > 0
    assert 0 < beside.scatter < 0.1 * beside.sigma
    assert jnp.zeros(()).dtype == jnp.float64  # and the others are left as they were


def test_settings_that_do_not_do_are_a_row_that_says_why(plain, scene):
    point = measure("three", Settings(binning=3), plain, scene)
    assert math.isnan(point.error)
    assert re.findall(r"\d+", point.message) == ["256", "3"]


def point(name, seconds, error):
    return Point(name, Settings(), seconds, bias=error, scatter=0.0, sigma=1.0, bound=1.0)


def test_the_front_is_what_nothing_beats():
    points = [point("a", 3, 0.1), point("b", 1, 0.5), point("c", 2, 0.6), point("d", 9, 0.01)]
    points += [Point("e", Settings(), message="no")]
    assert [p.name for p in front(points)] == ["b", "a", "d"]


def test_the_joint_fit_is_compared_with_the_most_exact_one(plain, scene, monkeypatch):
    given = []

    def noted(name, settings, instrument, scene, locus, reference=None):
        given.append((settings.pad, settings.method, reference))
        return point(name, 1, 1), (settings.pad, settings.method)

    monkeypatch.setattr(grid, "measure", noted)
    *_, last = measure_grid(plain, scene)
    assert last.name == "method joint"
    assert given[-2:] == [(128, "joint", None), (None, "joint", (128, "joint"))]
    assert all(reference == (128, "refit") for _, _, reference in given[1:-2])


def test_what_breaks_down_is_a_row_that_says_so(plain, scene, monkeypatch):
    def broken(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(grid.Fitting, "separations", broken)
    settings = Settings(samples=2, aberrations="expanded")  # whose programs another test compiles
    assert measure("one", settings, plain, scene).message == "Singular matrix"


def test_errors_add_in_squares():
    one = Point("one", Settings(), 1.0, bias=0.6, scatter=0.8, sigma=3.0, bound=2.0)
    assert one.error == pytest.approx(0.5)


def test_values_without_effect_on_an_instrument_are_left_out(plain, scene, monkeypatch):
    asked = []

    def noted(name, settings, *_):
        asked.append(name)
        return point(name, 1, 1), None

    monkeypatch.setattr(grid, "measure", noted)
    list(measure_grid(plain, scene))
    assert asked[:3] == ["exact", "balanced", "fast"]
    assert "pad 64" not in asked  # which balanced is
    assert "region 32" in asked
    assert "region 64" not in asked  # larger than the frame
    assert "samples 16" in asked  # of a band there may be more
    assert not [name for name in asked if "nodes" in name]  # a normal is a formula
    assert {"method score", "method mtf", "method joint"} <= set(asked)
    asked.clear()
    lamp = replace(plain, spectrum=type(plain.spectrum)((530.0, 640.0), (1.0, 1.0)))
    list(measure_grid(lamp, scene))
    assert "samples 1" in asked
    asked.clear()
    list(measure_grid(lamp, scene, locus="auto"))
    assert not [name for name in asked if "nodes" in name]
    asked.clear()
    list(measure_grid(lamp, scene, locus="path"))
    assert [name for name in asked if "nodes" in name] == [f"nodes {count}" for count in (4, 6, 8, 12)]
    assert "samples 5" not in asked  # of two lines there are no more


def test_the_table_has_every_number(plain):
    points = [
        Point("fast", PRESETS["fast"], 0.002, 1e-6, 0.0, 3e-6, 2e-6),
        Point("no", Settings(), message="why"),
    ]
    table = trade_table(points, plain)
    assert table["time"][0].to_value("s") == pytest.approx(0.002)
    assert table["bias"][0].to_value("arcsec") == pytest.approx(1e-6)
    assert list(table["front"]) == [True, False]
    assert table["message"][1] == "why"
    assert list(table["pad"]) == [PRESETS["fast"].pad, 64]
    assert list(table["samples"]) == [7, 7]


@pytest.mark.slow
def test_the_command_measures_writes_and_draws(tmp_path, monkeypatch):
    monkeypatch.setattr(grid, "GRID", {"tolerance": (1.0,)})
    table, picture = tmp_path / "trade.ecsv", tmp_path / "trade.png"
    few = {"exact": Settings(pad=8), "fast": Settings(pad=4), "balanced": Settings()}
    monkeypatch.setattr(grid, "preset", lambda name, _: few[name])
    done = CliRunner().invoke(
        app,
        ["trade", "-i", "plain", "--frames", "1", "-o", str(table), "--plot", str(picture)],
    )
    assert done.exit_code == 0, done.output
    rows = read_table(table)
    assert list(rows["setting"]) == ["exact", "balanced", "fast", "tolerance 1.0", "method joint"]
    assert np.all(np.isfinite(rows["error"]))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_jitter_that_is_not_computed_so_far_is_refused(plain):
    pair, wide = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0), PartialShm.of(12.0, 30.0, 3.0)
    with refused(ErrorCode.SAMPLING, "partial"):
        TradeScene.of(plain, pair, wide, 1, np.random.default_rng(0))
