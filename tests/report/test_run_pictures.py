"""Pictures of a run show what its table says, and only what so many frames can show."""

import io
import re

import numpy as np
import pytest
from long_run import DRIFT, ERROR, long_run
from matplotlib.collections import EllipseCollection
from PIL import Image
from scipy.stats import chi2

from jitterkit.report.jitter_plots import draw_jitter
from jitterkit.report.means import Clock, separation_series
from jitterkit.report.plots import plot_residual, png, small_png
from jitterkit.report.population_plots import plot_angles, plot_chi2, plot_loci, plot_shapes, plot_sizes
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.report.run_pictures import run_pictures
from jitterkit.report.summary import summarise
from jitterkit.report.table import make_table
from jitterkit.report.time_plots import draw_run, plot_root_n_error, plot_running_mean
from jitterkit.series import find_outliers


def _run(n, seed=1, **options):
    table = make_table(long_run(n, np.random.default_rng(seed), **options))
    return table, summarise(table)


def _labelled(ax, start):
    (found,) = (line for line in ax.lines if str(line.get_label()).startswith(start))
    return found


def _bars(ax):
    (container,) = ax.containers
    x, y = container.lines[0].get_data()
    ends = np.array([segment[:, 1] for segment in container.lines[2][0].get_segments()])
    return x, y, np.diff(ends, axis=1)[:, 0] / 2


@pytest.mark.parametrize(
    ("frames", "parts"),
    [
        (0, {}),
        (1, {}),
        (2, {"separation": 1}),
        (7, {"separation": 1}),
        (8, {"separation": 1, "averaging": 2, "jitter": 1}),
        (24, {"separation": 1, "averaging": 2, "jitter": 1}),
        (60, {"separation": 1, "averaging": 4, "jitter": 5, "fit": 2}),
    ],
)
def test_a_run_shows_what_so_many_frames_can(frames, parts):
    pictures = run_pictures(*_run(frames, failing=0.0))
    assert {part: sum(p.part == part for p in pictures) for part in {p.part for p in pictures}} == parts
    assert all(Image.open(io.BytesIO(p.png)).size[0] > 300 for p in pictures)
    assert all(p.alt for p in pictures)


def test_a_long_run_is_drawn_again_as_its_means():
    table, summary = _run(6000)
    frames, means = draw_run(table, summary, Clock.of(table))
    x, _, bars = _bars(means)
    assert len(x) <= 120
    assert np.median(bars) == pytest.approx(1e6 * ERROR / np.sqrt(6000 * 0.97 / len(x)), rel=0.3)
    assert np.ptp(means.get_ylim()) < 0.2 * np.ptp(frames.get_ylim())
    assert frames.get_xlim() == means.get_xlim()
    assert "UTC [min]" in means.get_xlabel()
    gap = (x > 5.2) & (x < 8.8)  # minutes: 300 s of frames, 240 s of none, 300 s of frames
    assert not gap.any()
    assert len(x) > 50


def test_means_of_frames_that_scatter_more_than_their_errors_have_wider_ones():
    table, summary = _run(6000)
    table["separation_err"] *= 0.5
    means = draw_run(table, summary, Clock.of(table))[1]
    (label,) = (t.get_text() for t in means.get_legend().texts if t.get_text().startswith("means"))
    assert float(label.rpartition("× ")[2]) == pytest.approx(2 * np.sqrt(1 + 0.002 * 144), rel=0.1)


def test_the_running_mean_ends_at_the_mean_and_its_error_falls_by_root_n(rng):
    errors = ERROR * rng.uniform(0.9, 1.1, 3000)
    values = 8.1 + errors * rng.standard_normal(3000)
    n, y = plot_running_mean(values, errors).lines[0].get_data()
    assert (n[-1], y[-1]) == (3000, pytest.approx(0, abs=1e-6))
    ax = plot_root_n_error(values, errors)
    n, stated = _labelled(ax, "stated").get_data()
    np.testing.assert_allclose(
        stated, 1e6 * ERROR / np.sqrt(n), rtol=0.12
    )  # the first error may be off by 10 %
    n, scatter = _labelled(ax, "error to judge").get_data()
    assert n[0] >= 8
    assert scatter[-1] == pytest.approx(stated[-1], rel=4 / np.sqrt(2 * 3000))


def test_what_does_not_average_parts_the_two_errors(rng):
    values = 8.1 + ERROR * rng.standard_normal(3000) + 3 * ERROR * np.repeat([-1, 1], 1500)
    ax = plot_root_n_error(values, np.full(3000, ERROR))
    stated, scatter = (_labelled(ax, name).get_ydata()[-1] for name in ("stated", "error to judge"))
    assert scatter / stated == pytest.approx(np.sqrt(10), rel=0.05)


def test_ellipses_along_the_axis_are_those_of_the_mean_moments():
    table, _ = _run(4000, failing=0.0)
    strip, sizes, angles = draw_jitter(table, Clock.of(table))
    (drawn,) = (c for c in strip.collections if isinstance(c, EllipseCollection))
    turned = 150 + 60 * np.concatenate([np.linspace(0, 0.5, 9), np.linspace(0.5, 1, 9)])
    measured = np.rad2deg(drawn._angles)  # 150 to 210 degrees with the part of the frames done
    apart = (np.interp(np.linspace(0, 1, len(measured)), np.linspace(0, 1, 18), turned) - measured + 90) % 180
    np.testing.assert_allclose(apart, 90, atol=9)
    assert "1σ" in strip.get_title()
    median = _labelled(sizes, "major").get_ydata()
    assert np.isnan(median).any()  # the gap
    assert np.nanmedian(median[:10]) == pytest.approx(120, rel=0.1)
    assert np.nanmedian(median[-10:]) == pytest.approx(234, rel=0.1)
    assert angles.get_ylim() == (0, 180)


def test_few_ellipses_are_those_of_the_frames():
    table, _ = _run(9, failing=0.0)
    strip, sizes, _ = draw_jitter(table, Clock.of(table))
    (drawn,) = (c for c in strip.collections if isinstance(c, EllipseCollection))
    major = table["jitter_major"].to_value("arcsec")
    np.testing.assert_allclose(2 * drawn._widths / (2 * drawn._widths).max(), major / major.max())
    np.testing.assert_allclose(
        np.rad2deg(drawn._angles)[major > 0] % 180, table["jitter_angle"].value[major > 0]
    )
    np.testing.assert_allclose(_labelled(sizes, "major").get_ydata(), 1e3 * major)


def test_sizes_are_counted_and_those_of_nothing_named():
    major = np.concatenate([np.full(80, 0.1), np.zeros(20)])
    ax = plot_sizes(major, np.zeros(100))
    assert sum(patch.get_height() for patch in ax.patches if hasattr(patch, "get_height")) == 80
    assert [t.get_text() for t in ax.get_legend().texts] == ["major axis (20 none)", "minor axis (100 none)"]


def test_a_rose_shows_both_ends_of_an_axis_with_areas_as_counts():
    ax = plot_angles(np.array([10.0] * 4 + [100.0] * 16), 204.0)
    spokes = {round(np.rad2deg(p.get_x())): p.get_height() for p in ax.patches if p.get_height() > 0}
    assert spokes == {0: 2.0, 180: 2.0, 90: 4.0, 270: 4.0}  # of so few frames a sector has 15 degrees
    assert sorted(len(plot_angles(np.full(n, 3.0)).patches) for n in (99, 999, 9999)) == [24, 36, 72]
    np.testing.assert_allclose(np.rad2deg(ax.lines[0].get_xdata()), [204, 384])


def test_loci_are_ranked_with_their_counts():
    ax = plot_loci(["shm"] * 3 + ["linear"] * 6 + [""])
    assert [t.get_text() for t in ax.get_yticklabels()] == ["shm", "linear"]
    assert [p.get_width() for p in ax.patches] == [3, 6]
    assert [t.get_text().strip() for t in ax.texts] == ["3 (33 %)", "6 (67 %)"]


def test_a_locus_is_no_formula():
    ax = plot_loci(["$\\frac{$", "$x$"])
    assert png(ax, 40).startswith(b"\x89PNG")


def test_shapes_stand_beside_those_of_plain_motions(rng):
    ax = plot_shapes(-1.2 + 0.1 * rng.standard_normal(400), np.full(400, 0.1))
    assert [line.get_xdata()[0] for line in ax.lines[:3]] == [-1.5, -1.2, 0.0]
    assert any("typical error 0.10" in t.get_text() for t in ax.get_legend().texts)


def test_chi_squared_lies_under_its_law(rng):
    dof = np.repeat([400, 900], 20_000)
    ax = plot_chi2(chi2.rvs(dof, random_state=rng) / dof, dof)
    (law,) = (p for p in ax.patches if not hasattr(p, "get_height"))
    heights = np.array([p.get_height() for p in ax.patches if hasattr(p, "get_height")])
    expected, edges, _ = law.get_data()
    assert heights.sum() == 40_000
    many = expected > 100
    assert many.sum() > 15
    np.testing.assert_allclose(heights[many], expected[many], atol=5 * np.sqrt(expected[many].max()))
    assert edges[0] < 0.8


def test_chi_squared_without_degrees_of_freedom_has_no_law(rng):
    ax = plot_chi2(rng.normal(1, 0.01, 100), np.zeros(100, int))
    assert len(ax.get_legend().texts) == 1


def test_captions_say_what_the_numbers_say(monkeypatch):
    monkeypatch.setattr("jitterkit.report.run_pictures.png", lambda ax, dpi: b"")
    table, summary = _run(3000)
    table["separation"] += np.arange(3000) * 20 * DRIFT * 60 / 3 * table["separation"].unit
    said = " ".join(picture.caption for picture in run_pictures(table, summary))
    slope, unit = re.search(r"\(([\d.]+) ± [\d.]+\) (.?as) per hour", said).groups()
    rate = 401 * DRIFT * 1e6 * 3000 / (3000 * 1.4 * 0.1) * 3600  # µas an hour, the gap included
    assert float(slope) == pytest.approx(rate / 1e3 if unit == "mas" else rate, rel=0.25)
    outliers = find_outliers(separation_series(table, Clock.of(table))).flags.sum()
    assert f"{outliers} frames" in said
    dof, chi2_dof = (np.asarray(table[name])[table["status"] == "ok"] for name in ("dof", "chi2_dof"))
    far = np.sum(chi2_dof > 1 + 4 * np.sqrt(2 / dof))
    assert f"{far} of {len(dof):,} frames" in said
    assert "4 sigmas" in said


def test_a_table_of_an_older_version_is_drawn_without_the_law(monkeypatch):
    table, summary = _run(60)
    table.remove_column("dof")
    monkeypatch.setattr("jitterkit.report.run_pictures.png", lambda ax, dpi: b"")
    assert any(picture.part == "fit" for picture in run_pictures(table, summary))


@pytest.mark.parametrize(
    "change",
    [
        {"separation": 8.1},
        {"separation_err": np.nan},
        {
            "jitter_major": 0.0,
            "jitter_minor": 0.0,
            "jitter_angle": np.nan,
            "sxx": 0.0,
            "sxy": 0.0,
            "syy": 0.0,
        },
        {"jitter_major": np.nan},
        {"chi2_dof": 1.0},
        {"chi2_dof": np.nan},
        {"shape": -1.2, "shape_err": 0.0},
        {"time": "2027-03-01T03:00:00"},
        {"theta": np.nan},
        {"status": "failed"},
        {"locus": ""},
    ],
    ids=lambda change: " ".join(f"{name}={value}" for name, value in change.items())[:40],
)
def test_runs_in_which_all_frames_are_alike_are_drawn_all_the_same(change, monkeypatch):
    monkeypatch.setattr("jitterkit.report.run_pictures.png", lambda ax, dpi: b"")  # what takes the time
    for frames in (30, 400):
        table = make_table(row | change for row in long_run(frames, np.random.default_rng(2)))
        run_pictures(table, summarise(table))


def test_one_wild_frame_among_copies_is_drawn_all_the_same():
    rows = [row | {"separation": 8.0} for row in long_run(400, np.random.default_rng(2), failing=0.0)]
    rows[7] |= {"separation": 9.0, "chi2_dof": 1.49}
    table = make_table(rows)
    assert "averaging" in {picture.part for picture in run_pictures(table, summarise(table))}


@pytest.mark.parametrize(("frames", "drawn"), [(7, 0), (8, 1)])
def test_the_stacked_residual_is_drawn_where_there_is_enough_to_test(frames, drawn, rng):
    table = make_table(long_run(frames, rng, failing=0.0))
    squares = np.array([480, 480 * 8.2]) * 256**2 * frames
    total = (256 * np.sqrt(frames) * rng.normal(size=(20, 24))).astype(int)
    stack = ResidualStack(0.375, frames, total, np.full((20, 24), frames), squares)
    pictures = run_pictures(table, summarise(table, stack), stack)
    assert [picture.part for picture in pictures].count("fit") == drawn


def test_a_small_picture_keeps_its_colours(rng):
    ax = plot_residual(rng.standard_normal((60, 60)) * 2)
    small, whole = (
        np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float) for data in (small_png(ax), png(ax))
    )
    assert len(small_png(ax)) < 0.4 * len(png(ax))
    assert (small[0, 0] == 255).all()
    # 64 steps of a map with 256 of each channel: two thirds of the pixels are within half a step, 255/63/2
    assert np.percentile(np.abs(small - whole).max(axis=2), 90) <= 6
