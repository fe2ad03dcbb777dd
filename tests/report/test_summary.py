import json
import math
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.frames import Metadata
from jitterkit.refit.result import Candidate, FitResult, Status
from jitterkit.report.flags import encode_flags
from jitterkit.report.means import weighted_mean
from jitterkit.report.row import make_row
from jitterkit.report.sequence import describe_loci, describe_misfits, describe_scatter
from jitterkit.report.summary import summarise, write_summary
from jitterkit.report.table import make_table


def _table(make_fit, separations, errors, theta=None, status="ok"):
    row = make_row(make_fit()[1], "f")
    theta = np.full(len(separations), 37.0) if theta is None else theta
    values = zip(separations, errors, theta, strict=True)
    return make_table(
        {**row, "separation": s, "separation_err": e, "theta": t, "status": status} for s, e, t in values
    )


def test_a_precise_frame_counts_by_the_square_of_its_error():
    combined = weighted_mean([1.0, 2.0], [0.1, 0.2])
    assert combined["mean"] == pytest.approx((1 * 4 + 2 * 1) / 5)
    assert combined["error"] == pytest.approx((100 + 25) ** -0.5)
    assert combined["chi2_dof"] == pytest.approx((0.2 / 0.1) ** 2 + (0.8 / 0.2) ** 2)
    assert combined["error_by_scatter"] == pytest.approx((100 + 25) ** -0.5 * math.sqrt(20))


@pytest.mark.parametrize(("other", "said"), [(6.0005, False), (9.0, True)])
def test_a_frame_of_another_target_is_named(make_fit, other, said):
    table = _table(make_fit, [6.001, 5.999, other, 6.0], [1e-3, 1e-3, 1e-3, 1e-3])
    table["frame"] = range(4)
    text = describe_scatter(table, summarise(table)["separation"])
    assert bool(text) == ("f [2]" in text) == said
    # about their mean of 6.75 the four deviate by 0.75 thrice and by 2.25: the rms over root 4 is 0.75
    assert ("750 mas" in text) == said


@pytest.mark.parametrize(("flagged", "said"), [([], ""), ([2], "1 of them"), ([0, 1, 2], "All of them")])
def test_frames_with_a_misfit_are_counted_apart(make_fit, flagged, said):
    table = _table(make_fit, [6.0, 6.002, 7.0], [1e-3, 1e-3, 1e-3])
    table["flags"] = [
        encode_flags(["misfit", "saturated"] if i in flagged else ["saturated"]) for i in range(3)
    ]
    separation = summarise(table)["separation"]
    assert (separation["n"], separation["misfit"]) == (3, len(flagged))
    others = separation["without_misfit"]
    assert others["n"] == 3 - len(flagged)
    if flagged == [2]:
        assert others["mean"] == pytest.approx(6.001)
        assert "6.0010" in describe_misfits(separation)
    assert describe_misfits(separation).startswith(said)
    assert bool(describe_misfits(separation)) == bool(said)


def test_scatter_matches_honest_errors(rng):
    n, error = 4000, 2.4e-4
    combined = weighted_mean(8.1 + error * rng.normal(size=n), np.full(n, error))
    assert abs(combined["mean"] - 8.1) < 4 * error / math.sqrt(n)
    assert abs(combined["chi2_dof"] - 1) < 4 * math.sqrt(2 / n)
    assert combined["error"] == pytest.approx(error / math.sqrt(n))
    assert combined["typical_error"] == error


def test_a_microarcsecond_is_not_lost_to_rounding():
    assert weighted_mean([8.1 + 1e-12, 8.1 - 1e-12], [1e-6, 1e-6])["mean"] == pytest.approx(8.1, abs=2e-15)


def test_what_has_no_error_is_left_out_and_one_frame_has_no_scatter():
    combined = weighted_mean([8.1, 9.0, np.nan, 7.0, 6.0], [0.1, np.nan, 0.1, 0.0, np.inf])
    assert (combined["n"], combined["mean"], combined["error"]) == pytest.approx((1, 8.1, 0.1))
    assert math.isnan(combined["chi2_dof"])
    assert weighted_mean([], [])["n"] == 0


def test_no_number_of_frames_averages_the_error_of_the_plate_scale_down(make_fit):
    known = Metadata().override("instrument file a.toml", plate_scale=0.375, plate_scale_err=1e-5)
    result = make_fit()[1]
    rows = [make_row(result, "f", metadata=known)] * 100
    separation = summarise(make_table(rows))["separation"]
    assert separation["scale_error"] == pytest.approx(result.of_scene("separation") * 1e-5)
    assert separation["error"] == pytest.approx(result.error("separation") / 10)
    unstated = summarise(make_table([make_row(result, "f")]))["separation"]
    assert math.isnan(unstated["scale_error"])


def test_the_mean_of_corrected_separations_is_of_frames_with_the_same_corrections(make_fit):
    result = make_fit()[1]
    separation = result.of_scene("separation")

    def mean(*known):
        rows = [make_row(result, "f", metadata=Metadata().override("header X", **one)) for one in known]
        return summarise(make_table(rows))["separation_corrected"]

    several = mean({"va_factor": 1.0001}, {"va_factor": 0.9999}, {"orbit_change": 0.5})
    assert several["n"] == 0  # no frame has what others have
    both = [{"va_factor": 1.0001, "orbit_change": 0.5}, {"va_factor": 0.9999, "orbit_change": 0.3}]
    several = mean(*both, {"va_factor": 1.0001}, {})
    assert several["n"] == 2
    assert several["mean"] == pytest.approx(separation - 0.4, rel=1e-12)
    assert several["error"] == pytest.approx(result.error("separation") / math.sqrt(2))
    assert mean({}, {})["n"] == 0


def test_only_good_frames_count(make_fit):
    good = make_row(make_fit("mvn")[1], "a")
    bad = {**good, "status": "poor_fit", "separation": 99.0, "locus": "shm"}
    lost = make_row(FitResult(Status.UNREADABLE, ""), "b")
    summary = summarise(make_table([good, bad, lost, good]))
    assert summary["frames"] == 4
    assert summary["status"] == {"ok": 2, "poor_fit": 1, "unreadable": 1}
    assert summary["locus"] == {"mvn": 2}
    assert summary["separation"]["mean"] == pytest.approx(good["separation"], abs=1e-15)
    assert summary["separation"]["unit"] == "arcsec"
    assert summary["seconds"] == 0.75


def test_directions_are_averaged_across_north(make_fit):
    summary = summarise(_table(make_fit, [8.1] * 3, [1e-4] * 3, theta=[359.0, 1.0, 3.0]))
    assert summary["theta"]["mean"] == pytest.approx(1.0)
    assert summary["theta"]["scatter"] == pytest.approx(2.0)


def test_crossed_smears_average_to_a_round_jitter(make_fit):
    row = make_row(make_fit("linear")[1], "f")
    crossed = {**row, "sxx": row["syy"], "syy": row["sxx"], "sxy": -row["sxy"]}
    jitter = summarise(make_table([row, crossed]))["jitter"]
    each = 0.75 / math.sqrt(12) / math.sqrt(2)
    assert (jitter["major"], jitter["minor"]) == pytest.approx((each, each))


def test_without_a_fit_every_number_is_null(tmp_path):
    table = make_table([make_row(FitResult(Status.NO_DATA, ""), "f")])
    write_summary(tmp_path / "summary.json", summarise(table))
    text = (tmp_path / "summary.json").read_text()
    summary = json.loads(text)
    assert "NaN" not in text
    assert summary["separation"]["n"] == 0
    assert summary["separation"]["mean"] is None
    assert summary["jitter"]["major"] is None
    assert summarise(make_table([]))["frames"] == 0


def _compared(make_fit, *evidences, separation=8.1):
    """A table of frames with candidates of these log-evidences, a dictionary each."""
    rows = []
    for k, values in enumerate(evidences):
        tried = [
            Candidate(name, -2 * value, 0.5, separation + (name == "shm") * 3e-6 + k * 1e-4, 2e-4, value)
            for name, value in values.items()
        ]
        rows.append(make_row(replace(make_fit("linear")[1], candidates=tuple(tried)), f"{k}"))
    return make_table(rows)


def test_the_evidence_of_frames_adds_up(make_fit):
    undecided = {"linear": -100.0, "shm": -100.3, "mvn": -104.0}
    loci = summarise(_compared(make_fit, *[undecided] * 30))["loci"]
    assert (loci["frames"], loci["left_out"], loci["best"]) == (30, 0, "linear")
    assert loci["evidence"]["shm"] == pytest.approx(-9.0)  # 30 times 0.3
    assert loci["weights"]["shm"] == pytest.approx(math.exp(-9) / (1 + math.exp(-9) + math.exp(-120)))
    assert sum(loci["weights"].values()) == pytest.approx(1.0)
    separations = loci["separation"]
    assert separations["shm"]["mean"] - separations["linear"]["mean"] == pytest.approx(3e-6, abs=1e-9)
    assert separations["shm"]["error"] == pytest.approx(2e-4 / math.sqrt(30))


def test_a_run_says_what_it_has_decided_and_what_not(make_fit):
    undecided = {"linear": -100.0, "shm": -100.3, "mvn": -104.0}

    def said(*frames, **options):
        return describe_loci(summarise(_compared(make_fit, *frames, **options))["loci"])

    many = said(*[undecided] * 30)
    assert all(value in many for value in ("30 frames", "linear", "1.000"))
    assert "shm" not in many
    # e^-1.5 is 0.22 of one; the separations are made 3 microarcsec apart
    few = said(*[undecided] * 5)
    assert all(value in few for value in ("5 frames", "linear 0.82", "shm 0.18", "3.0 µas"))
    assert said(undecided, separation=math.nan).endswith("undecided (linear 0.57, shm 0.42).")  # of one star
    drift, vibration = {"linear": -100.0, "shm": -101.5}, {"linear": -120.0, "shm": -100.0}
    mixed = said(*[drift] * 30, vibration)
    assert "1 of 31" in mixed
    assert "linear" in mixed
    assert said({"mvn": -1.0}) == ""


def test_only_frames_that_tried_the_same_loci_are_compared(make_fit):
    usual, odd = {"linear": -1.0, "shm": -2.0}, {"linear": -9.0, "shm": -1.0, "path": -0.5}
    broken, plain = {"linear": -1.0, "shm": -math.inf}, {"mvn": -1.0}
    loci = summarise(_compared(make_fit, *[usual] * 60, odd, broken, plain))["loci"]
    # the path was tried once, one frame has no evidence for SHM and one has nothing to compare
    assert (loci["frames"], loci["left_out"]) == (61, 2)
    assert set(loci["weights"]) == {"linear", "shm"}
    assert loci["evidence"]["shm"] == pytest.approx(8.0 - 60.0)
    assert summarise(_compared(make_fit, plain))["loci"] == {"frames": 0, "left_out": 1}


def test_frames_that_needed_no_other_locus_are_not_left_out_of_a_comparison(make_fit):
    # a drift and a vibration are alike; other loci are tried where noise narrows the image
    odds = np.random.default_rng(4).normal(0.0, 1.0, 60)
    frames = [{"mvn": -2.0, "linear": 0.0, "shm": x} if x > 0 else {"mvn": -2.0} for x in odds]
    assert summarise(_compared(make_fit, *frames))["loci"]["frames"] == 0


def test_a_locus_with_an_evidence_only_where_noise_favours_it_does_not_win(make_fit):
    # smear is on average 2 worse than linear, with a scatter of 3; below none it has no evidence at all
    odds = np.random.default_rng(4).normal(-2.0, 3.0, 60)
    frames = [{"linear": 0.0, "shm": -0.5, "smear": x if x > 0 else -math.inf} for x in odds]
    loci = summarise(_compared(make_fit, *frames))["loci"]
    assert (loci["best"], loci["frames"]) == ("linear", 60)
    assert "smear" not in loci["weights"]


def test_the_shape_is_averaged_by_its_errors(make_fit):
    fit = make_fit()[1]
    rows = [make_row(replace(fit, shape=s, shape_err=e), "f") for s, e in ((-1.0, 0.1), (-2.0, 0.2))]
    assert summarise(make_table(rows))["shape"]["mean"] == pytest.approx((-1 * 4 - 2) / 5)
