"""Priors from files: tables and traces, in which the frame's own row is not counted twice."""

import re
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.estimators import estimate_score
from jitterkit.loci import Mvn
from jitterkit.refit import FitOptions, Priors, fit_frame, kernel_prior, read_kernel_prior, sequence_prior


def write_table(path, found):
    from astropy import units
    from astropy.table import QTable

    table = QTable()
    table["file"], table["frame"] = ["night.fits"] * len(found), list(range(len(found)))
    table["status"], table["estimator"] = ["ok"] * len(found), ["score"] * len(found)
    for i, name in enumerate(("sxx", "sxy", "syy")):
        table[name] = [e.moments[i] for e in found] * units.arcsec**2
        table[f"{name}_err"] = [e.errors[i] for e in found] * units.arcsec**2
    if any(e.digest for e in found):
        table["digest"] = [e.digest for e in found]
    table.write(path, format="ascii.ecsv")
    return path


def test_a_frames_own_kernel_estimate_adds_no_information(bench, rng, tmp_path):
    data, start = bench.draw(bench.truth(Mvn.of(0.1, 0.05, 20.0)), rng), bench.near()
    own = replace(estimate_score(data, start, bench.optics.nominal), source="night.fits[0]")
    without = fit_frame(data, bench.optics, start)
    file = read_kernel_prior(write_table(tmp_path / "own.ecsv", [own]))
    known = replace(own, digest="5ba3c0ffee15900d")
    sealed = read_kernel_prior(write_table(tmp_path / "sealed.ecsv", [known]))
    for priors in (
        kernel_prior(own, "night.fits"),
        file.of("night.fits"),
        file.of("night.fits[0]"),
        file.of("night.fits", known.digest),  # a table without digests goes by the name
        kernel_prior(known, "renamed.fits", known.digest),
        sealed.of("renamed.fits", known.digest),
    ):
        assert priors == Priors()
    result = fit_frame(data, bench.optics, start, options=FitOptions(priors=priors))
    np.testing.assert_array_equal(result.covariance, without.covariance)
    # the same numbers from another frame do sharpen it, by their own information and no more
    other = fit_frame(
        data, bench.optics, start, options=FitOptions(priors=kernel_prior(own, "night.fits[1]"))
    )
    slots = [without.names.index(name) for name in Mvn.names]
    told = np.linalg.inv(without.covariance)
    told[np.ix_(slots, slots)] += np.linalg.inv(own.covariance)
    expected = np.sqrt(np.diag(np.linalg.inv(told)))
    # the information moves with the fit, by less than a tenth of an error of the moments
    np.testing.assert_allclose(np.sqrt(np.diag(other.covariance)), expected, rtol=0.02)
    np.testing.assert_allclose(other.crlb, without.crlb, rtol=0.02)


def test_a_sequence_says_the_same_with_and_without_the_frames_own_estimate(rng, tmp_path, estimates, same):
    found = estimates(rng, 8)
    others = found[:3] + found[4:]
    assert same(sequence_prior(found, "night.fits[3]"), sequence_prior(others, "night.fits[3]"))
    assert not same(sequence_prior(found, "day.fits"), sequence_prior(others, "day.fits"))
    # however often and by whatever method the frame was estimated
    again = [*found, replace(found[3], method="mtf", moments=np.ones(3))]
    assert same(sequence_prior(again, "night.fits[3]"), sequence_prior(others, "night.fits[3]"))
    file = read_kernel_prior(write_table(tmp_path / "night.ecsv", found))
    ours = file.of("night.fits[3]").moments
    for read, made in zip(ours, sequence_prior(others, "night.fits[3]").moments, strict=True):
        np.testing.assert_allclose(read, made, rtol=1e-12)


def test_pixels_tell_a_frames_own_row_whatever_its_name(rng, tmp_path, estimates, same):
    found = [replace(e, digest=f"{k:016x}") for k, e in enumerate(estimates(rng, 8))]
    others = found[:3] + found[4:]
    without = sequence_prior(others, "night.fits[3]")
    everything = sequence_prior(found, "day.fits")
    file = read_kernel_prior(write_table(tmp_path / "night.ecsv", found))
    own, foreign = found[3].digest, "f" * 16
    assert same(sequence_prior(found, "renamed.fits", own), without)
    assert same(file.of("renamed.fits", own), file.of("night.fits[3]"))
    # another night's frame of the same name is another frame
    assert same(sequence_prior(found, "night.fits[3]", foreign), everything)
    assert same(file.of("night.fits[3]", foreign), file.of("day.fits"))
    assert kernel_prior(found[3], "night.fits[3]", foreign).moments is not None
    # rows of an older table among them go by the name
    mixed = [*found[:3], replace(found[3], digest=""), *found[4:]]
    assert same(sequence_prior(mixed, "night.fits[3]", foreign), without)
    file = read_kernel_prior(write_table(tmp_path / "mixed.ecsv", mixed))
    assert [e.digest for e in file.estimates] == [e.digest for e in mixed]


def test_a_row_whose_digest_is_missing_goes_by_its_name(rng, tmp_path, estimates):
    from astropy.table import QTable, vstack

    (one,) = estimates(rng, 1)
    old = QTable.read(write_table(tmp_path / "old.ecsv", [one]), format="ascii.ecsv")
    sealed = [replace(e, digest="0" * 16) for e in estimates(rng, 6)]
    new = QTable.read(write_table(tmp_path / "new.ecsv", sealed), format="ascii.ecsv")
    vstack([old, new]).write(tmp_path / "both.ecsv", format="ascii.ecsv")
    assert [e.digest for e in read_kernel_prior(tmp_path / "both.ecsv").estimates] == ["", *["0" * 16] * 6]


@pytest.mark.parametrize("column", ["sxx", "syy_err"])
def test_a_row_with_an_empty_cell_is_no_estimate(rng, tmp_path, estimates, column):
    from astropy.table import QTable
    from astropy.utils.masked import Masked

    found = estimates(rng, 9)
    table = QTable.read(write_table(tmp_path / "all.ecsv", found), format="ascii.ecsv")
    table[column] = Masked(table[column], mask=np.arange(9) == 4)
    table.write(tmp_path / "gap.ecsv", format="ascii.ecsv")
    kept = read_kernel_prior(tmp_path / "gap.ecsv").estimates
    assert [e.source for e in kept] == [f"night.fits[{k}]" for k in range(9) if k != 4]


def test_a_frame_is_given_its_own_row_by_its_pixels_from_file_to_fit(telescope, tmp_path, rng):
    from jitterkit.batch import FrameProcessor
    from jitterkit.batch.template_blur import TemplateBlurEstimator
    from jitterkit.frames import write_fits
    from jitterkit.report.flags import decode_flags
    from jitterkit.run import process_files
    from jitterkit.run.estimate import estimate_files
    from jitterkit.scene import Binary
    from jitterkit.simulate import fits_header, simulate_frame

    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        folder.mkdir()
        scene = Binary(5.0, 30.0, 1.0, -2.0, 1.2e5, 3.37)
        drawn = simulate_frame(telescope, scene, Mvn.of(0.1, 0.05, 20.0), rng=rng)
        header = fits_header(drawn, telescope)
        write_fits(folder / "frame.fits", drawn.raw.data.astype(np.uint16), header=header)
    first = folders[0] / "frame.fits"
    (tmp_path / "renamed.fits").write_bytes(first.read_bytes())
    plain = FrameProcessor(telescope, locus="mvn")
    estimate_files([first], TemplateBlurEstimator(plain)).write(tmp_path / "e.ecsv", format="ascii.ecsv")
    told = replace(plain, prior=read_kernel_prior(tmp_path / "e.ecsv"))
    files = [tmp_path / "renamed.fits", folders[1] / "frame.fits"]
    without = process_files(files, tmp_path / "without", plain).table
    table = process_files(files, tmp_path / "told", told).table
    assert set(table["status"]) == {"ok"}
    errors = ("separation_err", "sxx_err", "sxy_err", "syy_err")
    assert all(table[name][0] == without[name][0] for name in errors)  # to the bit
    assert "prior_unused" in decode_flags(table["flags"][0])
    # of two measurements as good as each other the error is a square root of two smaller
    assert table["sxx_err"][1] < 0.8 * without["sxx_err"][1]
    assert "prior_unused" not in decode_flags(table["flags"][1])
    # a frame of this name in another folder may be the same exposure, calibrated
    assert ["prior_namesake" in decode_flags(flags) for flags in table["flags"]] == [False, True]
    assert "frame.fits" in table["message"][1]


def test_too_few_frames_do_not_show_a_scatter(rng, tmp_path, estimates):
    with refused(ErrorCode.TOO_FEW, 6, 5):
        sequence_prior(estimates(rng, 6), "night.fits[2]")
    with refused(ErrorCode.TOO_FEW, tmp_path / "few.ecsv", 3, 7):
        read_kernel_prior(write_table(tmp_path / "few.ecsv", estimates(rng, 3)))


def test_files_that_hold_no_prior_are_refused(tmp_path, rng, estimates):
    text = tmp_path / "notes.ecsv"
    text.write_text("a letter\n")
    with refused(ErrorCode.MALFORMED, text):
        read_kernel_prior(text)
    with refused(ErrorCode.NOT_FOUND, tmp_path / "missing.ecsv"):
        read_kernel_prior(tmp_path / "missing.ecsv")
    (tmp_path / "folder.ecsv").mkdir()
    with refused(ErrorCode.NOT_READABLE, tmp_path / "folder.ecsv"):
        read_kernel_prior(tmp_path / "folder.ecsv")
    from astropy.table import QTable

    path = write_table(tmp_path / "k.ecsv", estimates(rng, 8))
    table = QTable.read(path, format="ascii.ecsv")
    bare = table.copy()
    bare.remove_column("sxy_err")
    bare.write(tmp_path / "bare.ecsv", format="ascii.ecsv")
    with refused(ErrorCode.MISSING_VALUE, tmp_path / "bare.ecsv", "'sxy_err'"):
        read_kernel_prior(tmp_path / "bare.ecsv")
    table["status"] = ["no_star"] * 8
    table.write(tmp_path / "dark.ecsv", format="ascii.ecsv")
    with refused(ErrorCode.NO_DATA, tmp_path / "dark.ecsv", 8):
        read_kernel_prior(tmp_path / "dark.ecsv")
    pixels = QTable.read(path, format="ascii.ecsv")
    pixels["sxx"] = pixels["sxx"].value
    pixels.write(tmp_path / "pixels.ecsv", format="ascii.ecsv")
    with refused(ErrorCode.UNKNOWN_UNIT, tmp_path / "pixels.ecsv", "'sxx'", "arcsec2"):
        read_kernel_prior(tmp_path / "pixels.ecsv")


def test_a_trace_in_a_file_is_a_prior_for_every_frame(tmp_path, same):
    t = np.linspace(0, 0.1, 101)
    path = tmp_path / "gyro.csv"
    lines = [f"{a},{b},0.0" for a, b in zip(t.tolist(), (3.0 * t).tolist(), strict=True)]
    path.write_text("\n".join(["t,x,y", *lines]) + "\n")
    prior = read_kernel_prior(path, exposure=0.1)
    assert prior.of("a.fits").moments[0][0] == pytest.approx(0.3**2 / 12, rel=1e-3)
    assert same(prior.of("a.fits"), prior.of("b.fits"))
    assert prior.remark == ""


def test_a_trace_longer_than_the_exposure_says_what_of_it_is_used(tmp_path):
    t = np.linspace(0, 1, 101)
    path = tmp_path / "gyro.csv"
    path.write_text("\n".join(["t,x,y", *(f"{a},{a},0.0" for a in t.tolist())]) + "\n")
    for exposure, values in ((0.6, ["0.6", "1"]), (0.1, ["1", "10", "0.1"])):
        assert re.findall(r"[\d.]*\d", read_kernel_prior(path, exposure=exposure).remark) == values
    assert read_kernel_prior(path).remark == ""


def test_a_table_with_correlations_gives_the_whole_covariance(rng, tmp_path, estimates):
    from astropy.table import QTable

    (found,) = estimates(rng, 1)
    mixing = np.array([[3.0, 1.0, -2.0], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]) * 1e-3
    found = replace(found, covariance=mixing @ mixing.T)
    path = write_table(tmp_path / "one.ecsv", [found])
    bare = read_kernel_prior(path).of("day.fits").moments[1]
    np.testing.assert_allclose(bare, np.diag(np.diag(found.covariance)), atol=1e-18)
    table = QTable.read(path, format="ascii.ecsv")
    own = found.covariance / np.outer(found.errors, found.errors)
    for name, i, j in (("sxx_sxy_corr", 0, 1), ("sxx_syy_corr", 0, 2), ("sxy_syy_corr", 1, 2)):
        table[name] = [own[i, j]]
    table.write(tmp_path / "whole.ecsv", format="ascii.ecsv")
    whole = read_kernel_prior(tmp_path / "whole.ecsv").of("day.fits").moments[1]
    np.testing.assert_allclose(whole, found.covariance, rtol=1e-12)
    table["sxx_syy_corr"] = [1.2]
    table.write(tmp_path / "odd.ecsv", format="ascii.ecsv")
    with refused(ErrorCode.NO_DATA, tmp_path / "odd.ecsv"):
        read_kernel_prior(tmp_path / "odd.ecsv")
