"""The paper's numerics against direct sums, and the parts of ``scripts/reproduce_paper`` on a few points."""

import importlib
import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, image_and_jacobian
from jitterkit.loci import LOCI, Linear, Shm, Stable, axis_variances
from jitterkit.optics import Grid, expand, lines, obstructed_circle
from jitterkit.scene import Binary

SCRIPTS = Path(__file__).parents[1] / "scripts"
FX, FY = np.linspace(-1.3, 1.3, 7), np.linspace(1.1, -0.9, 7)


@pytest.fixture(scope="module")
def scripts():
    """Modules of the scripts by name; the script itself by ``reproduce_paper``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCRIPTS))
        names = ("biases", "errors", "loci", "numbers", "numerics", "public", "study")
        modules = {name: importlib.import_module(f"paper_{name}") for name in names}
        yield modules | {"reproduce_paper": runpy.run_path(str(SCRIPTS / "reproduce_paper"))}
    for name in [name for name in sys.modules if name.startswith("paper_")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def small(scripts):
    """A plain telescope with coma in TOLIMAN's place, and a small frame."""
    pupil = obstructed_circle(0.125, 0.04, noll=(7, 8), samples=128)
    return scripts["study"].study_of(pupil, (48, 48), coarse=True)


def test_the_public_streaks_are_sums_of_five_phasors(scripts):
    positions = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])
    # time of a sinusoid of amplitude 0.3 within half a step of each place
    within = np.arcsin(np.clip(np.array([-2, -1.5, -0.5, 0.5, 1.5, 2]) / 2, -1, 1)) / np.pi
    along = FX * np.cos(np.radians(25.0)) + FY * np.sin(np.radians(25.0))
    for name, weights in (("linear", np.full(5, 0.2)), ("shm", np.diff(within))):
        locus = scripts["numerics"].PUBLIC_LOCI[name].of(0.6, 25.0)
        expected = np.exp(-2j * np.pi * np.outer(along, positions)) @ weights
        np.testing.assert_allclose(locus.transfer(FX, FY), expected.real, atol=1e-14)
        variance, none, angle = axis_variances(locus.moments())
        assert (variance, none, angle) == pytest.approx((weights @ positions**2, 0, 25.0), abs=1e-12)


def test_five_equal_images_have_the_variance_of_harmonic_motion(scripts):
    linear, shm = (kind.variance for kind in scripts["numerics"].PUBLIC_LOCI.values())
    assert linear == pytest.approx(1 / 8, rel=1e-14)
    assert linear == pytest.approx(1.5 * Linear.variance)
    assert shm == pytest.approx(1.11 * Shm.variance, rel=2e-3)


def test_the_mean_over_points_of_a_pixel_is_the_mean_over_points(scripts):
    pupil, spectrum = obstructed_circle(0.125, 0.04, noll=(7,), samples=64), lines(530.0, 640.0)
    optics = expand(pupil, spectrum, Grid((24, 24), 0.375, 12))
    sampled = scripts["numerics"].point_sampled(optics)
    # no pixel, so that a sample is the light there; and the stars moved against it by each point's offset
    bare = replace(optics, pixel_included=True)
    scene = Parameters(Binary(3.0, 160.0, 0.1, 0.2, 1e5, 3.0), Stable.of(), np.zeros(1))
    offsets = 0.375 * (np.arange(4) - 1.5) / 4
    points = [(x, y) for x in offsets for y in offsets]
    moved = [seen_from(scene, x, y) for x, y in points]
    found, rows = image_and_jacobian(scene, sampled, (0, 6))
    mean = np.mean([expected_image(one, bare) for one in moved], axis=0)
    np.testing.assert_allclose(found, mean, atol=1e-9 * mean.max())
    slopes = np.mean([image_and_jacobian(one, bare, (0, 6))[1] for one in moved], axis=0)
    for row, slope in zip(rows, slopes, strict=True):  # of the separation, and of coma
        np.testing.assert_allclose(row, slope, atol=1e-9 * np.abs(slope).max())


def seen_from(parameters, x, y):
    """The same scene seen from a point beside the pixel's centre."""
    pair = parameters.binary
    moved = Binary(pair.separation, pair.theta, pair.x - x, pair.y - y, pair.flux, pair.contrast)
    return Parameters(moved, parameters.locus, parameters.aberrations)


@pytest.mark.parametrize("samples", [4, 6, 8])
def test_points_lack_variance_of_a_pixel(scripts, small, samples):
    otf = small.exact.nominal
    fx = otf.grid.frequencies[1][0]
    lower = scripts["numerics"].point_sampled(otf, samples).value[0]
    exact = (otf.value * np.sinc(0.375 * fx))[0]
    # M = 1 - 2 pi² f² variance + O(f⁴); at the lowest frequency, 0.014, f⁴ is 1e-6 of that
    missing = np.log(np.abs(lower[1] / exact[1])) / (2 * np.pi**2 * fx[1] ** 2)
    assert missing == pytest.approx(0.375**2 / (12 * samples**2), rel=1e-4)


def test_the_papers_normal_is_rounder_and_larger_than_asked(scripts):
    numerics = scripts["numerics"]
    found = axis_variances(numerics.normal_of_shear(0.2, 0.75, 30.0).moments())
    assert found == pytest.approx((0.04, 0.01, 30.0))  # half as wide as long, not a quarter
    major, minor, _ = axis_variances(numerics.normal_of_construction(1e-4, 0.75).moments())
    assert (major, minor) == pytest.approx((0.04, 0.01))  # sqrt(det)/(1 - 0.75), sqrt(det)
    assert major * minor == pytest.approx(4e-4)  # four times the determinant that was asked for


def test_the_papers_area_is_that_of_diameters_taken_for_radii(scripts):
    numbers = scripts["numbers"]
    slip = scripts["numerics"].area_of_diameters_as_radii(numbers.DIAMETER, numbers.OBSCURATION)
    assert slip == pytest.approx(np.pi * (12.5**2 - 3.2**2), rel=1e-12)  # cm²
    assert slip == pytest.approx(numbers.AREA.value, rel=1e-4)
    product = numbers.RATE.value * numbers.AREA.value * numbers.EXPOSURE.value
    assert product == pytest.approx(numbers.PHOTONS.value, rel=2e-4)


@pytest.mark.slow
def test_the_page_holds_every_row_slip_and_picture(scripts, small, tmp_path):
    script = scripts["reproduce_paper"]
    parts = script["run"](["still", "photons", "matrices", "frames", "streaks", "histogram"], small, tmp_path)
    page = script["report"](parts)
    rows = {row.quantity: row for part in parts.values() for row in part.rows}
    lines = [line for line in page.splitlines() if line.startswith("| ")]
    assert sum(line.count("|") == 8 for line in lines) == len(rows) + 1
    assert re.findall(r"^(\d)\. ", page, re.MULTILINE) == ["1", "3", "9"]
    pictures = {name for part in parts.values() for name in part.pictures}
    assert pictures == {path.stem for path in tmp_path.glob("*.png")}
    assert {path.stem for path in tmp_path.glob("streaks_*.ecsv")} == set(parts["streaks"].tables)
    assert pictures == set(re.findall(r"\((\w+)\.png\)", page))
    assert rows["collecting area"].exact == pytest.approx(rows["collecting area"].public / 4)
    still = rows["σ(separation), no jitter"]
    assert still.public < still.exact  # points lack blur
    assert rows["frames to 1 µas"].exact == pytest.approx(still.exact**2)
    assert rows["variance of linear, in L²/12"].public == pytest.approx(1.5)


def test_every_bias_has_a_row_in_both_numerics(scripts, small, monkeypatch):
    asked = []

    def bias(study, truth, model, optics):
        asked.append((type(truth).__name__, model, LOCI["linear"]))
        return SimpleNamespace(bias=1e-6 * len(asked), misfit=1e5)

    monkeypatch.setattr(scripts["biases"], "_bias", bias)
    part = scripts["biases"].cross_fits(replace(small, coarse=False))
    assert len(part.rows) == len(asked) / 2 == 9 + 16
    assert [row.exact for row in part.rows] == [pytest.approx(2 * n + 2) for n in range(25)]
    spread = np.sqrt(2 * np.prod(small.exact.grid.shape))
    assert f" {1e5 / spread:.0f} " in part.rows[0].remark
    public = scripts["numerics"].FiveEqualImages
    # the paper's streaks are lent to the registry for the paper's fits, and given back
    assert [one[2] for one in asked[:2]] == [public, Linear]
    assert LOCI["linear"] is Linear
    # after three rows of stable, 0° and 90° are the fourth and the sixth
    assert re.findall(r"\d+\.\d+", part.slips[10])[:3] == ["8.00", "12.0", "0.1"]


@pytest.mark.slow
def test_a_bias_is_that_of_exact_models_and_of_the_papers(scripts, toliman):
    study, biases = scripts["study"].study_of(toliman), scripts["biases"]
    exact = biases._bias(study, Shm.of(0.225), "mvn", study.exact)
    assert 1e6 * exact.bias == pytest.approx(2.6, rel=0.03)  # SCIENCE, section 7
    points = biases.pixels(study).rows[:3]
    # SCIENCE, section 8: 4, 6 and 8 points in a row, given to the microarcsecond
    assert [one.public for one in points] == pytest.approx([-45, -20, -11], abs=0.6)


def test_a_part_that_there_is_not_is_refused(scripts):
    script = scripts["reproduce_paper"]
    assert script["chosen"]("still,pixels") == ["still", "pixels"]
    with pytest.raises(script["argparse"].ArgumentTypeError, match=r"'figure9'.*still"):
        script["chosen"]("still,figure9")


def test_the_public_layers_turn_in_opposite_directions(scripts, small):
    pytest.importorskip("dLuxToliman")
    normal, harmonic, _ = scripts["public"].layers(small).rows
    assert normal.public == pytest.approx(30.0, abs=0.1)
    assert harmonic.public == pytest.approx(-30.0, abs=0.5)
