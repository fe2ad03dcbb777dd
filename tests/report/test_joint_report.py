"""Table, summary, words and picture of a joint fit, of likelihood summaries written by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.joint import (
    Constant,
    FrameRecord,
    LikelihoodSummaries,
    LikelihoodSummary,
    OrnsteinUhlenbeck,
    Polynomial,
    Records,
    Rows,
    SequenceFit,
    combine,
)
from jitterkit.refit import Status
from jitterkit.report.flags import decode_flags
from jitterkit.report.joint_plots import plot_run
from jitterkit.report.joint_summary import describe_joint_fit, joint_summary
from jitterkit.report.joint_table import frame_table, separation_series
from jitterkit.report.sequence import describe_run_fit
from jitterkit.report.table import read_table, write_table
from jitterkit.series import fit_floor

OWN = ("x", "y", "flux", "linear_c", "linear_s")
ERROR = 1e-4


def made(
    rng, *, slope=0.0, odd=(), frames=30, rows=None, stated=(np.nan,) * 3, bare=(), chi2_dof=1.0, flags=(),
    aberrations=None, turned=(),
):  # fmt: skip
    """A sequence whose separations scatter by their errors; one frame in the middle could not be read."""
    summaries, records = LikelihoodSummaries(("separation", "noll4")), Records(OWN)
    information = np.diag([ERROR**-2, 25.0])
    for i in range(frames):
        time = 0.1 * i
        if i == 5:
            records.append(
                FrameRecord("torn", np.nan, Status.UNREADABLE, "torn: it is cut short.", reason="truncated")
            )
            continue
        best = np.array(
            [10 + ERROR * rng.standard_normal() + slope * (time - 1.5), 0.2 * rng.standard_normal()]
        )
        best += 0.01 * (i in odd), 8.0 * (i in turned)
        summaries.append(LikelihoodSummary(time, best, np.zeros(2), information))
        own = np.array([0.3 * time, 0.4 * time, 1e5, 0.04, 0.0])
        records.append(
            FrameRecord(
                f"frame {i}", time, Status.OK, "fitted", flags, own, np.full(5, 0.1),
                np.array([0.01, 0.0, 0.0]), np.full(3, 1e-3), chi2_dof, own[:2], np.array([-0.3, 0.0]),
                np.full(3, np.nan) if i in bare else np.array(stated), has_summary=True, dof=16e3,
            )
        )  # fmt: skip
    time_models = {"separation": Constant(), "noll4": aberrations or OrnsteinUhlenbeck(1.0, 2.0)}
    return SequenceFit(
        combine(summaries, time_models), summaries, records, time_models, "linear", (np.inf, 0.1), 3.0, rows
    )


def test_a_row_a_frame_with_units_and_reasons(rng, tmp_path):
    fit = made(rng, odd=(9,))
    write_table(tmp_path / "sequence.ecsv", frame_table(fit))
    table = read_table(tmp_path / "sequence.ecsv")
    assert len(table) == 30
    assert table["status"][5] == "unreadable"
    assert table["reason"][5] == "truncated"
    assert table["message"][5] == "torn: it is cut short."
    assert set(np.delete(np.asarray(table["reason"]), 5)) == {""}
    assert np.flatnonzero(~np.asarray(table["counted"], bool)).tolist() == [5, 9]
    assert "outlier" in decode_flags(table["flags"][9])
    units = {
        name: str(table[name].unit) for name in ("separation", "x", "flux", "sxx", "shared_noll4", "time")
    }
    assert units == {
        "separation": "arcsec", "x": "arcsec", "flux": "electron", "sxx": "arcsec2", "shared_noll4": "nm",
        "time": "s",
    }  # fmt: skip
    # the streak lies along x, and the image went the other way
    assert table["smear_direction"][0].value == pytest.approx(180.0)


def test_a_sequence_is_corrected_for_the_sky(rng):
    fit = made(rng, stated=(np.nan, 1.0001, 0.25))
    separation = joint_summary(fit)["separation"]
    assert separation["corrected"] == pytest.approx(separation["mean"] * 1.0001 - 0.25, rel=1e-8)
    row = frame_table(fit)[0]
    assert row["separation_corrected"].value == pytest.approx(row["separation"].value * 1.0001 - 0.25)
    assert (row["va_factor"], row["orbit_change"].value) == (1.0001, 0.25)
    assert np.isnan(joint_summary(made(rng))["separation"]["corrected"])


def test_a_sequence_of_which_some_frames_lack_a_correction_is_not_corrected(rng):
    summary = joint_summary(made(rng, stated=(np.nan, 1.0001, np.nan), bare=(3, 4)))
    assert np.isnan(summary["separation"]["corrected"])
    assert any("2 frames lack" in sentence for sentence in describe_joint_fit(summary))


@pytest.mark.parametrize(("chi2_dof", "flags", "said"), [(1.0, (), False), (1.02, ("misfit",), True)])
def test_a_sequence_says_that_its_mean_chi_squared_is_too_high(rng, chi2_dof, flags, said):
    summary = joint_summary(made(rng, chi2_dof=chi2_dof, flags=flags))
    # 0.02 of 16,000 degrees, whose chi-squared scatters by root 32,000, in each of 29 frames
    expected = (chi2_dof - 1) * 16e3 / np.sqrt(32e3) * np.sqrt(29)
    assert summary["fit"]["sigmas"] == pytest.approx(expected)
    assert bool(describe_run_fit(summary["fit"])) == said
    assert any("29 of the frames" in sentence for sentence in describe_joint_fit(summary)) == said


def test_the_error_of_the_plate_scale_is_not_averaged_down(rng):
    fit = made(rng, stated=(1e-5, np.nan, np.nan))
    separation = joint_summary(fit)["separation"]
    assert separation["scale_error"] == pytest.approx(1e-4, rel=1e-4)
    assert separation["error"] == pytest.approx(ERROR / np.sqrt(29), rel=1e-6)
    table = frame_table(fit)
    assert table["separation_scale_err"][0].to_value("uas") == pytest.approx(100, rel=1e-3)
    assert np.isnan(table["separation_scale_err"][5])  # could not be read
    assert np.isnan(joint_summary(made(rng))["separation"]["scale_error"])


def test_the_summary_is_what_the_likelihood_summaries_give(rng):
    fit = made(rng)
    summary = json.loads(json.dumps(joint_summary(fit, fit_floor(separation_series(fit)))))
    assert summary["frames"] == 30
    assert summary["counted"] == 29
    assert summary["status"] == {"ok": 29, "unreadable": 1}
    assert summary["separation"]["error"] == pytest.approx(ERROR / np.sqrt(29), rel=1e-6)
    assert summary["separation"]["error_of_a_frame"] == pytest.approx(ERROR, rel=1e-9)
    assert summary["shared"]["noll4"]["law"] == {"kind": "wander", "rms": 1.0, "timescale": 2.0}
    assert describe_joint_fit(summary) == []


def test_what_a_person_should_know_is_said(rng):
    told = describe_joint_fit(joint_summary(made(rng, slope=5e-4, odd=(9,))))
    assert "1 frames" in told[0]
    assert "frame 9." in told[0]
    assert " 1." in told[1]  # 5e-4 arcsec/s in arcsec an hour, to its error
    assert "an hour" in told[1]


def test_a_motion_that_is_not_known_under_a_rolling_shutter_is_said(rng):
    rows = Rows(line_time=1.5e-5, modelled=True, leverage=4e-4, unknown=0.7)
    (told,) = describe_joint_fit(joint_summary(made(rng, rows=rows)))
    assert "280 µas" in told
    assert "--telemetry" in told
    assert describe_joint_fit(joint_summary(made(rng, rows=rows._replace(unknown=0.01)))) == []


def test_telemetry_that_does_not_move_the_image_as_the_frames_do_is_said(rng):
    rows = Rows(line_time=1.5e-5, modelled=True, leverage=4e-4, unknown=0.7, by_telemetry=True)
    (told,) = describe_joint_fit(joint_summary(made(rng, rows=rows)))
    assert "280 µas" in told
    assert "signs" in told


@pytest.mark.parametrize(("odd", "said"), [((), False), ((3, 4), False), (tuple(range(15, 30)), True)])
def test_frames_that_disagree_in_what_is_not_the_separation_are_said(rng, odd, said):
    """Half of the frames of the other side of a meridian: what they share differs by 40 errors."""
    fit = made(rng, aberrations=Constant(), turned=odd)
    summary = joint_summary(fit)
    assert summary["contradicting"] == 29 * said
    assert summary["separation"]["chi2_dof"] < 2
    assert any("29 frames contradict" in told for told in describe_joint_fit(summary)) == said


def test_a_slope_is_that_of_the_summaries(rng):
    fit = made(rng, slope=5e-4)
    slope = fit.slope()
    assert slope.rate == pytest.approx(5e-4, abs=4 * slope.error)
    times = np.array([m.time for m in fit.summaries])
    assert slope.error == pytest.approx(ERROR / np.sqrt(np.sum((times - times.mean()) ** 2)), rel=1e-4)
    bent = combine(fit.summaries, {**fit.time_models, "separation": Polynomial(1)})
    assert bent.evidence > fit.combined.evidence


@pytest.mark.parametrize("odd", [(), (9,)])
def test_the_page_has_four_pictures(rng, odd):
    axes = plot_run(made(rng, odd=odd))
    assert [ax.get_ylabel() for ax in axes] == [
        "midpoint [arcsec]", "blur [arcsec]", "shared, from its mean [nm]", "χ² against the others",
    ]  # fmt: skip
    labels = [text.get_text() for text in axes[3].get_legend().get_texts()]
    assert labels == (["counted", "not counted"] if odd else ["counted"])


@pytest.mark.parametrize(("correlation", "factor"), [(0.5, 2 / np.sqrt(3)), (0.98, 5.0252)])
def test_a_plate_scale_that_can_hardly_be_determined_is_said(rng, correlation, factor):
    fit = made(rng)
    known = np.outer([1e-5, 1e-6], [1e-5, 1e-6]) * [[1, correlation], [correlation, 1]]
    names = ("separation", "plate_scale_shift")
    combined = replace(fit.combined, names=names, values=np.zeros(2), covariance=known)
    time_models = dict.fromkeys(names, Constant())
    summary = joint_summary(replace(fit, combined=combined, time_models=time_models))
    assert summary["separation"]["scale_factor"] == pytest.approx(factor, rel=1e-4)
    assert any(f"{factor:.1f} times" in told for told in describe_joint_fit(summary)) == (factor > 2)
