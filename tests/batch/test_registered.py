"""Frames of a run that are registered to one of them, from files to table."""

from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from records import process_batches
from scipy.ndimage import shift

from jitterkit.batch import FrameProcessor, steps
from jitterkit.batch.plan import FrameReader, plan_batches
from jitterkit.batch.template_blur import TemplateBlurEstimator
from jitterkit.frames import write_fits
from jitterkit.instruments import load_instrument
from jitterkit.loci import Mvn, Stable
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.report.flags import decode_flags
from jitterkit.run.estimate import estimate_files
from jitterkit.scene import Binary, Star
from jitterkit.simulate import simulate_frame

FRAMES, OTHER = 12, 7
"""Of a night; and the place of one of another pair."""


@pytest.fixture(scope="module")
def telescope():
    """One of its own: frames are compared in a cut-out, which is smaller only of a large frame."""
    pupil, band = obstructed_circle(0.09, 0.03, noll=(7, 8), samples=160), flat_band(530.0, 640.0, 3)
    return replace(load_instrument("smallsat"), pupil_from=pupil, spectrum=band)


@pytest.fixture(scope="module")
def night(telescope, tmp_path_factory):
    """Twelve frames, each blurred otherwise; and the truth."""
    directory, rng, truth = tmp_path_factory.mktemp("night"), np.random.default_rng(6), []
    for number in range(FRAMES):
        locus, (x, y) = Mvn.of(rng.uniform(0.1, 0.2), 0.05, rng.uniform(0, 180)), rng.uniform(-2, 2, 2)
        scene = Binary(15.0 if number == OTHER else 10.0, 30.0, x, y, 2e5, 3.37)
        image = simulate_frame(telescope, scene, locus, aberrations=[5.0, -8.0], rng=rng).raw.data
        write_fits(directory / f"{number:02d}.fits", image.astype(np.float32))
        truth.append(np.asarray(locus.moments()))
    return sorted(directory.iterdir()), np.array(truth)


def test_every_frame_has_its_blur_and_only_the_odd_one_is_searched_through(telescope, night, searched):
    (files, truth), kept = night, []
    table = estimate_files(files, TemplateBlurEstimator(FrameProcessor(telescope)), keep=kept.append)
    assert list(table["status"]) == ["ok"] * FRAMES
    assert not any("correlated" in message for message in table["message"])
    assert {name for name in searched if name != files[0].name} == {files[OTHER].name}
    pulls = [
        (table[n].value - truth[:, i]) / table[f"{n}_err"].value for i, n in enumerate(("sxx", "sxy", "syy"))
    ]
    assert np.sum(np.square(pulls)) < 36 + 4 * np.sqrt(72)  # chi-squared of 36 degrees of freedom
    assert kept[0].evidence.parameters.scene.name == "binary"


@pytest.mark.slow
def test_registered_frames_that_were_resampled_are_told_by_their_noise(telescope, night, tmp_path):
    """Bilinear interpolation: frames that are registered to another are like it, whatever was done to all."""
    files, _ = night
    for file in files[:4]:
        data = fits.getdata(file)
        write_fits(tmp_path / file.name, shift(data, 0.5, order=1, mode="nearest"))
    table = estimate_files(sorted(tmp_path.iterdir()), TemplateBlurEstimator(FrameProcessor(telescope)))
    assert ["correlated (0." in message for message in table["message"]] == [True] * 4


def test_derivatives_have_less_padding_where_the_stars_are_those_of_the_reference_frame(telescope, night):
    files, _ = night
    ((batch),) = plan_batches(files, [1] * FRAMES, FRAMES)
    task = FrameProcessor(telescope).for_batch(batch)
    with FrameReader() as reader:
        frames = [task.calibrate(raw) for _, _, raw in reader.read(batch.items[:3])]
    starts = [task.estimate(frame, rough=True) for frame in frames]
    for start in starts:
        fine = start.otf.grid.fine_shape
        assert np.prod(start.otf.coarse.grid.fine_shape) < 0.75 * np.prod(fine)
        assert start.otf.coarse.value.dtype == np.complex64
    ((key, warm),) = task.known.items()
    moved = replace(warm.reference, parameters=warm.reference.parameters.shifted(8.5 * key[1], 0.0))
    assert warm.reference.is_near(warm.reference.locate(starts[1].data))
    assert not moved.is_near(warm.reference.locate(starts[1].data))


def test_threads_do_not_matter(telescope, night, monkeypatch):
    files, _ = night
    tables = []
    for threads in (1, 3):
        monkeypatch.setattr(TemplateBlurEstimator, "threads", threads)
        tables.append(estimate_files(files, TemplateBlurEstimator(FrameProcessor(telescope))))
    for name in tables[0].colnames:
        np.testing.assert_array_equal(np.asarray(tables[0][name]), np.asarray(tables[1][name]), err_msg=name)


@pytest.fixture
def searched(monkeypatch):
    """Names of frames that were searched through."""
    names, search = [], steps.search

    def noted(frame, *given, **options):
        names.append(frame.name)
        return search(frame, *given, **options)

    monkeypatch.setattr(steps, "search", noted)
    return names


@pytest.mark.slow
def test_frames_of_one_star_are_registered_to_one_that_shows_it(telescope, searched, tmp_path):
    rng, truth = np.random.default_rng(7), []
    for number in range(FRAMES):
        locus, (x, y) = Mvn.of(rng.uniform(0.1, 0.2), 0.05, rng.uniform(0, 180)), rng.uniform(-2, 2, 2)
        image = simulate_frame(telescope, Star(x, y, 2e5), locus, aberrations=[5.0, -8.0], rng=rng).raw.data
        write_fits(tmp_path / f"{number:02d}.fits", image.astype(np.float32))
        truth.append([*np.asarray(locus.moments()), x, y])
    batches = plan_batches(sorted(tmp_path.iterdir()), [1] * FRAMES, FRAMES)
    (done,) = process_batches(batches, FrameProcessor(telescope, locus="mvn"))
    assert {(row["status"], row["scene"]) for row in done.rows} == {("ok", "star")}
    assert len(set(searched)) <= 4  # the lead's, until their scene is in no doubt
    known = ("sxx", "sxy", "syy", "x", "y")
    pulls = [
        [(row[name] - value) / row[f"{name}_err"] for name, value in zip(known, values, strict=True)]
        for row, values in zip(done.rows, truth, strict=True)
    ]
    assert np.sum(np.square(pulls)) < 60 + 4 * np.sqrt(120)  # chi-squared of 60 degrees of freedom


@pytest.mark.slow
def test_frames_of_a_run_share_the_ambiguity_and_an_odd_one_its_own_scene(telescope, tmp_path):
    """Of two stars much closer than the resolution, all frames say so; a wide pair among them is a pair."""
    rng = np.random.default_rng(8)
    for number in range(9):
        close = Binary(0.25, 30.0, *rng.uniform(-2, 2, 2), 2e5, 1.0)
        scene = Binary(10.0, 30.0, 0.0, 0.0, 2e5, 3.37) if number == OTHER else close
        image = simulate_frame(telescope, scene, Stable.of(), aberrations=[5.0, -8.0], rng=rng).raw.data
        write_fits(tmp_path / f"{number:02d}.fits", image.astype(np.float32))
    batches = plan_batches(sorted(tmp_path.iterdir()), [1] * 9, 9)
    (done,) = process_batches(batches, FrameProcessor(telescope, locus="mvn"))
    other = done.rows.pop(OTHER)
    assert (other["status"], other["scene"]) == ("ok", "binary")
    assert {(row["status"], row["scene"]) for row in done.rows} == {("ok", "star")}
    assert all("maybe_pair" in decode_flags(row["flags"]) for row in done.rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        pytest.param({"locus": "auto"}, marks=pytest.mark.slow),
        pytest.param({"kernel": "mtf"}, marks=pytest.mark.slow),
    ],
)
def test_a_fit_begins_where_a_frame_repeats_another_and_ends_where_it_would_alone(
    telescope, night, searched, options
):
    files, _ = night
    processor = FrameProcessor(telescope, **{"locus": "mvn", **options})
    batches = plan_batches(files, [1] * FRAMES, FRAMES)
    rows = [row for part in process_batches(batches, processor) for row in part.rows]
    assert {name for name in searched if name != files[0].name} == {files[OTHER].name}
    some = slice(None, None, 3)
    with FrameReader() as reader:
        raws = [raw for _, _, raw in reader.read([(path, 0) for path in files[some]])]
    for raw, row in zip(raws, rows[some], strict=True):
        alone = FrameProcessor(telescope, **{"locus": "mvn", **options}).process(raw).result
        for name in ("separation", "theta", "x", "flux", "contrast"):
            assert abs(row[name] - alone.of_scene(name)) < 0.05 * alone.error(name)
        assert row["separation_err"] == pytest.approx(alone.error("separation"), rel=2e-3)


@pytest.mark.slow
def test_fits_of_repeated_frames_are_the_same_to_the_last_digit_whoever_works_and_whatever_was_before(
    telescope, night
):
    files, _ = night
    first, second = plan_batches(files, [1] * FRAMES, 8)

    def rows(*batches, threads):
        done = [*process_batches(batches, FrameProcessor(telescope, locus="mvn"), threads=threads)][-1]
        return [repr({**row, "seconds": 0.0}) for row in done.rows]

    assert rows(second, threads=1) == rows(first, second, threads=3)


@pytest.mark.slow
def test_a_frame_that_a_locus_does_not_fit_is_not_searched_through_for_that(telescope, searched, tmp_path):
    """The pair is in no doubt; what fails is what was asked for."""
    rng = np.random.default_rng(9)
    deep = replace(telescope, detector=replace(telescope.detector, full_well=1e7, bits=22))
    scene, locus = Binary(10.0, 30.0, 0.3, -0.4, 2e7, 3.37), Mvn.of(0.5, 0.3, 20.0)
    for n in range(8):
        raw = simulate_frame(deep, scene, locus, aberrations=[5.0, -8.0], rng=rng).raw
        write_fits(tmp_path / f"{n}.fits", raw.data)
    files = sorted(tmp_path.iterdir())
    processor = FrameProcessor(deep, locus="stable")
    (done,) = process_batches(plan_batches(files, [1] * 8, 8), processor)
    assert [row["status"] for row in done.rows] == ["poor_fit"] * 8
    assert set(searched) == {files[0].name}  # to know what the others may repeat
