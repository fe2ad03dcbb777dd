"""The joint fit: against one big fit of all frames, its own bound, and motions that are known."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from own_images import pupil_places, star_image
from refusals import refused

from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.forward import GRADIENT, Parameters, expected_image
from jitterkit.frames import Frame
from jitterkit.frames.metadata import Metadata
from jitterkit.joint import (
    Constant,
    Exposure,
    FrameFitter,
    FrameRecord,
    LikelihoodSummaries,
    OrnsteinUhlenbeck,
    Polynomial,
    Records,
    SequenceOptions,
    refit_sequence,
)
from jitterkit.joint.frame_fitter import _alike
from jitterkit.joint.records import record_of
from jitterkit.joint.refit import _require_fitted
from jitterkit.loci import Linear, Mvn
from jitterkit.optics import Colours, obstructed_circle
from jitterkit.refit import FitResult, Priors, Status
from jitterkit.report.joint_summary import joint_summary
from jitterkit.report.residual_stack import LatestPass, most_stacked
from jitterkit.report.sequence import describe_run_fit
from jitterkit.scene import Binary, FurtherStars, Star
from jitterkit.shutter import Drifting

STEP = 0.1
TORN = FitResult(Status.UNREADABLE, "torn: it is cut short.", code=ErrorCode.TRUNCATED)
SCENE = Binary(5.0, 30.0, 0.0, 0.0, 2e6, 2.5)


def exposures(optics, count, rng, *, loci=None, states=None, scenes=None, velocity=None, line_time=None):
    """Frames of counted electrons, ``STEP`` apart."""
    made = []
    for i in range(count):
        scene = {name: float(getattr(SCENE, name)) for name in Binary.own}
        scene |= {} if scenes is None else {name: float(values[i]) for name, values in scenes.items()}
        state = np.zeros(2) if states is None else states[i]
        shutter = None if velocity is None else Drifting(line_time, velocity, 4)
        locus = Mvn.of(0.1) if loci is None else loci[i]
        truth = Parameters(Binary(**scene), locus, state, shutter=shutter)
        image = np.asarray(expected_image(truth, optics.otf(state, derivatives=False)))
        counts = image if rng is None else rng.poisson(image).astype(float)
        known = Metadata().override("argument", line_time=line_time)
        frame = Frame(counts, 0.0, exposure=STEP, plate_scale=0.375, metadata=known)
        made.append(Exposure(f"frame {i}", (i + 0.5) * STEP, frame))
    return made


def test_equal_frames_are_one_frame_of_their_sum(optics, rng):
    # shared and own alike are the same in every frame, so the sum of the frames is as good as all of them
    frames = exposures(optics, 6, None)
    time_models = {"aberrations": Constant()}
    joint = refit_sequence(frames, FrameFitter(optics), SequenceOptions(time_models=time_models))
    single = refit_sequence(frames[:1], FrameFitter(optics), SequenceOptions(time_models=time_models))
    assert joint.separation[0] == pytest.approx(5.0, abs=1e-7)
    assert joint.separation[1] == pytest.approx(single.separation[1] / np.sqrt(6), rel=1e-5)


def test_a_third_star_is_fitted_in_every_frame_wherever_the_pair_stands(optics, rng, monkeypatch):
    """Without it no frame is described."""
    exposed, further = [], FurtherStars(-2.5, 3.0, 4e3)
    for i, (dx, dy) in enumerate([(0.0, 0.0), (0.7, -0.4), (-0.9, 0.3), (0.2, 0.8)]):
        scene = Binary(**SCENE.values, others=further).shifted(dx, dy)
        image = np.asarray(expected_image(Parameters(scene, Mvn.of(0.1), np.zeros(2), 30.0), optics.nominal))
        frame = Frame(rng.poisson(image).astype(float), 0.0, exposure=STEP, plate_scale=0.375)
        exposed.append(Exposure(f"frame {i}", (i + 0.5) * STEP, frame))
    time_models = SequenceOptions(time_models={"aberrations": Constant()})
    joint = refit_sequence(exposed, FrameFitter(optics), time_models)
    assert all(record.status is Status.OK for record in joint.records)
    assert abs(joint.separation[0] - 5.0) < 3.5 * joint.separation[1]
    monkeypatch.setattr("jitterkit.locate.search.with_further_stars", lambda start, *_, **__: start)
    with pytest.raises(JitterkitError, match="does not describe the frame"):
        refit_sequence(exposed[:2], FrameFitter(optics), time_models)


def test_separation_is_unbiased_and_its_error_honest(optics, rng):
    pulls = []
    for _ in range(12):
        positions = {"x": rng.normal(0, 0.4, 8), "y": rng.normal(0, 0.4, 8)}
        fit = refit_sequence(exposures(optics, 8, rng, scenes=positions), FrameFitter(optics))
        value, error = fit.separation
        pulls.append((value - 5.0) / error)
        assert fit.combined.kept.all()
    assert abs(np.mean(pulls)) < 3 / np.sqrt(12)
    assert 0.5 < np.std(pulls) < 1.7  # 12 pulls: 0.2


def test_a_different_streak_in_each_frame_and_optics_that_vary(optics, rng):
    count = 24
    states = np.cumsum(rng.normal(0, 0.5, (count, 2)), axis=0)
    loci = [Linear.of(size, angle) for size, angle in zip(
        rng.uniform(0.3, 0.6, count), rng.uniform(0, 180, count), strict=True)]  # fmt: skip
    positions = {"x": np.cumsum(rng.normal(0, 0.2, count)), "y": np.cumsum(rng.normal(0, 0.2, count))}
    frames = exposures(optics, count, rng, loci=loci, states=states, scenes=positions)
    fit = refit_sequence(frames, FrameFitter(optics, "linear"))
    value, error = fit.separation
    assert abs(value - 5.0) < 4 * error
    assert isinstance(fit.time_models["noll7"], OrnsteinUhlenbeck)
    # a walk of 0.5 nm a step: rms²/timescale is the variance of a step over twice its length
    assert fit.time_models["noll7"].rms ** 2 / fit.time_models["noll7"].timescale == pytest.approx(
        0.25 / (2 * STEP), rel=1.0
    )
    shared, slots = list(fit.combined.shared()), [fit.combined.names.index(f"noll{j}") for j in (7, 8)]
    pulls = np.array(
        [(one.values[slots] - state) / one.errors[slots] for one, state in zip(shared, states, strict=True)]
    )
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.4)  # 48 pulls: 0.1, smoothed ones more
    lengths = [Linear(jnp.asarray(r.values[3:5])).describe()["length"] for r in fit.records]
    assert np.allclose(lengths, [one.describe()["length"] for one in loci], atol=0.1)
    assert np.allclose([r.values[0] for r in fit.records], positions["x"], atol=0.02)


def test_weighted_mean_of_the_frames_is_the_joint_separation(optics, rng):
    fit = refit_sequence(exposures(optics, 10, rng), FrameFitter(optics))
    frames = list(fit.frames())
    values, errors = (np.array([getattr(f, n) for f in frames]) for n in ("separation", "separation_err"))
    assert np.average(values, weights=errors**-2) == pytest.approx(fit.separation[0], abs=1e-9)


@pytest.mark.slow
def test_a_rolling_shutter_is_undone_by_the_motion_between_frames(optics):
    velocity, line_time = np.array([3.0, 5.0]), 1e-4
    positions = {"x": 0.3 * np.arange(10) - 1.5, "y": 0.5 * np.arange(10) - 2.5}
    loci = [Linear.of(float(np.hypot(*velocity)) * STEP, np.degrees(np.arctan2(5, 3)))] * 10
    frames = exposures(optics, 10, None, loci=loci, scenes=positions, velocity=velocity, line_time=line_time)
    with_rows = refit_sequence(frames, FrameFitter(optics, "linear"))
    without = refit_sequence(frames, FrameFitter(optics, "linear"), SequenceOptions(rolling=False))
    # the rule: v tau sep sin²(theta) / p and the like for the cross term; of milliarcseconds here
    assert abs(without.separation[0] - 5.0) > 2e-3
    assert with_rows.separation[0] == pytest.approx(5.0, abs=2e-6)
    assert np.allclose([r.velocity for r in with_rows.records], velocity, atol=2e-3)


@pytest.mark.slow
def test_telemetry_takes_the_place_of_the_motion_between_frames(optics):
    velocity, line_time = np.array([0.0, 5.0]), 1e-4
    streak = [Linear.of(0.5, 90.0)] * 3
    # that stand in one place meanwhile
    frames = exposures(optics, 3, None, loci=streak, velocity=velocity, line_time=line_time)
    t = np.linspace(-0.1, 1.0, 50)
    told = (t, 0 * t, 5.0 * t)
    fit = refit_sequence(frames, FrameFitter(optics, "linear"), SequenceOptions(telemetry=told))
    assert fit.separation[0] == pytest.approx(5.0, abs=2e-6)
    with refused(ErrorCode.IMPLAUSIBLE, "50 arcsec/s", "3 of 3"):
        refit_sequence(frames, FrameFitter(optics, "linear"), SequenceOptions(telemetry=(t, 0 * t, 50.0 * t)))
    short = (np.array([0.0, 0.2]), np.zeros(2), np.zeros(2))
    with refused(ErrorCode.OUT_OF_RANGE, "0 to 0.2 s"):
        refit_sequence(frames, FrameFitter(optics, "linear"), SequenceOptions(telemetry=short))


@pytest.mark.slow
def test_diffusion_is_distinguished_from_streaks_that_differ(optics, rng):
    loci = [Linear.of(0.5, angle) for angle in np.linspace(0, 180, 10, endpoint=False)]
    frames = []
    for exposure, locus in zip(exposures(optics, 10, rng, loci=loci), loci, strict=True):
        truth = Parameters(SCENE, locus, np.zeros(2), diffusion=0.1**2)
        counts = rng.poisson(np.asarray(expected_image(truth, optics.nominal))).astype(float)
        frames.append(exposure._replace(frame=replace(exposure.frame, electrons=counts)))
    fit = refit_sequence(frames, FrameFitter(optics, "linear", diffusion=True))
    value, error = fit.combined.value("diffusion"), fit.combined.error("diffusion")
    assert error < 0.002
    assert abs(value - 0.01) < 4 * error
    with refused(ErrorCode.NOT_CONSTRAINED, "'mvn'", "linear"):
        FrameFitter(optics, "mvn", diffusion=True)


def test_a_frame_that_does_not_belong_is_flagged_and_not_counted(optics, rng):
    scenes = {"separation": np.full(10, 5.0)}
    scenes["separation"][6] = 5.01
    fit = refit_sequence(exposures(optics, 10, rng, scenes=scenes), FrameFitter(optics))
    assert np.flatnonzero(~fit.combined.kept).tolist() == [6]
    assert [frame.kept for frame in fit.frames()] == [i != 6 for i in range(10)]
    assert abs(fit.separation[0] - 5.0) < 4 * fit.separation[1]


def test_a_slow_change_is_reported(optics, rng):
    scenes = {"separation": 5.0 + 2e-3 * np.linspace(-1, 1, 12)}
    fit = refit_sequence(exposures(optics, 12, rng, scenes=scenes), FrameFitter(optics))
    slope = fit.slope()
    true = 2e-3 / (11 * STEP / 2)
    assert slope.rate == pytest.approx(true, abs=4 * slope.error)
    assert slope.chi2 > 25
    bent = refit_sequence(
        exposures(optics, 12, rng, scenes=scenes),
        FrameFitter(optics),
        SequenceOptions({"separation": Polynomial(1)}),
    )
    assert abs(bent.combined.value("separation") - 5.0) < 4 * bent.combined.error("separation")


def test_frames_that_cannot_be_used_keep_their_rows(optics, rng):
    frames = exposures(optics, 5, rng)
    frames[1] = Exposure("torn", float("nan"), None, TORN)
    blank = replace(frames[3].frame, electrons=rng.poisson(20.0, (48, 44)).astype(float))
    frames[3] = frames[3]._replace(frame=blank)
    fit = refit_sequence(frames, FrameFitter(optics))
    rows = list(fit.frames())
    assert [row.record.status.usable for row in rows] == [True, False, True, False, True]
    assert rows[1].record.message == TORN.message
    assert [row.record.reason for row in rows] == ["", "truncated", "", "no_star", ""]
    assert [row.kept for row in rows] == [True, False, True, False, True]
    assert abs(fit.separation[0] - 5.0) < 4 * fit.separation[1]


@pytest.mark.slow
def test_frames_of_one_star_have_no_separation(optics, rng):
    frames = exposures(optics, 3, rng)
    truth = Parameters(Star(0.3, -0.2, 2e6), Linear.of(0.8, 70.0), np.zeros(2))
    image = np.asarray(expected_image(truth, optics.otf(np.zeros(2), derivatives=False)))
    stars = [
        one._replace(frame=replace(one.frame, electrons=rng.poisson(image).astype(float))) for one in frames
    ]
    with refused(ErrorCode.NO_PAIR, "only one star", "process", error=JitterkitError):
        refit_sequence(stars, FrameFitter(optics, "linear"))


def test_no_frame_at_all_is_an_error_with_the_first_reason(optics):
    with refused(ErrorCode.TRUNCATED, TORN.message, error=JitterkitError):
        refit_sequence([Exposure("torn", 0.0, None, TORN)], FrameFitter(optics))
    with refused(ErrorCode.NO_DATA, error=JitterkitError):
        refit_sequence([], FrameFitter(optics))


def test_a_frame_alone_that_was_fitted_and_determines_nothing_is_not_constrained():
    records = Records(())
    records.append(FrameRecord("endless", 0.0, Status.OK, ""))
    with refused(ErrorCode.NOT_CONSTRAINED, error=JitterkitError):
        _require_fitted(LikelihoodSummaries(("separation",)), records)


def test_frames_out_of_order_are_refused(optics, rng):
    frames = exposures(optics, 2, rng)
    with refused(ErrorCode.OUT_OF_RANGE, "frame 0", "0.05 s", "0.15 s") as caught:
        refit_sequence(frames[::-1], FrameFitter(optics))
    assert "--cadence" not in str(caught.value)  # which takes them in the wrong order, without a word
    alike = [frame._replace(time=0.05) for frame in frames]
    with refused(ErrorCode.OUT_OF_RANGE, "frame 1", "0.05 s", "0.05 s", "--cadence"):
        refit_sequence(alike, FrameFitter(optics))


def test_a_law_for_what_is_not_shared_is_refused(optics, rng):
    with refused(ErrorCode.UNKNOWN_NAME, "'flux'", "separation", "'aberrations'"):
        refit_sequence(exposures(optics, 1, rng), FrameFitter(optics), SequenceOptions({"flux": Constant()}))


def test_a_direction_at_the_seam_and_stars_as_bright_as_each_other(optics, rng):
    # theta to either side of 360 degrees from frame to frame, and who is the brighter left to noise
    scenes = {"theta": np.full(8, 359.9999), "contrast": np.full(8, 1.0005)}
    fit = refit_sequence(exposures(optics, 8, rng, scenes=scenes), FrameFitter(optics))
    assert fit.combined.kept.all()
    turned = (fit.combined.value("theta") - 359.9999 + 90) % 180 - 90
    assert abs(turned) < 4 * fit.combined.error("theta")
    assert abs(fit.separation[0] - 5.0) < 4 * fit.separation[1]


def test_a_pair_that_jumps_is_found_again(optics, rng):
    positions = {
        "x": np.array([0.0, 0.1, 2.5, -2.4, 0.2, 0.1]),
        "y": np.array([0.0, 2.2, -2.0, 2.4, 0.0, -0.1]),
    }
    fit = refit_sequence(exposures(optics, 6, rng, scenes=positions), FrameFitter(optics))
    assert fit.combined.kept.all()
    assert np.allclose([r.values[0] for r in fit.records], positions["x"], atol=0.02)


def test_a_prior_parts_jitter_from_diffusion(optics):
    # noise-free: the diffusion is what the prior leaves of the blur, also where the prior is off
    truth = Parameters(SCENE, Mvn.of(0.1), np.zeros(2), diffusion=0.01)
    image = np.asarray(expected_image(truth, optics.nominal))
    frame = Frame(image, 0.0, exposure=STEP, plate_scale=0.375)
    frames = [Exposure(f"frame {i}", (i + 0.5) * STEP, frame) for i in range(3)]
    for told in (0.010, 0.012):
        known = (np.array([told, 0.0, told]), 1e-6 * np.eye(3))
        fitter = FrameFitter(optics, "mvn", diffusion=True, priors=Priors(moments=known))
        fit = refit_sequence(frames, fitter, SequenceOptions({"aberrations": Constant()}))
        assert fit.combined.value("diffusion") == pytest.approx(0.02 - told, abs=1e-5)


def test_frames_that_disagree_all_over_are_all_counted_and_their_scatter_says_so(optics, rng):
    scenes = {"separation": 5.0 + 0.1 * np.arange(6)}
    fit = refit_sequence(exposures(optics, 6, rng, scenes=scenes), FrameFitter(optics))
    assert fit.combined.kept.all()
    assert fit.separation[0] == pytest.approx(5.25, abs=5e-3)
    values = np.array([f.separation for f in fit.frames()])
    assert np.allclose(values, scenes["separation"], atol=0.02)


def test_few_frames_whose_optics_are_anywhere(optics, rng):
    frames = exposures(optics, 6, rng, states=rng.normal(0, 5.0, (6, 2)))
    fit = refit_sequence(frames, FrameFitter(optics))
    assert fit.combined.kept.all()
    assert len(fit.summaries) == 6
    assert abs(fit.separation[0] - 5.0) < 4 * fit.separation[1]


def test_steps_between_exposures_are_not_motion_within_them(optics):
    positions = {"y": 0.4 * np.arange(8) - 1.6}  # stands still while the shutter is open
    frames = exposures(optics, 8, None, scenes=positions, line_time=1e-4)
    fit = refit_sequence(frames, FrameFitter(optics))
    assert fit.separation[0] == pytest.approx(5.0, abs=1e-5)
    assert fit.rows.unknown > 1


def test_a_long_exposure_at_the_end_does_not_exclude_the_motion_of_short_ones(optics):
    speed, times = 5.0, np.array([0.05, 0.15, 0.25, 0.35, 0.9])  # arcsec/s; the last is exposed for 1 s
    made = []
    for time, exposure in zip(times, [STEP] * 4 + [10 * STEP], strict=True):
        locus = {"loci": [Linear.of(speed * exposure, 90.0)], "scenes": {"y": [speed * (time - 0.5)]}}
        (one,) = exposures(optics, 1, None, velocity=np.array([0.0, speed]), line_time=1e-4, **locus)
        made.append(one._replace(time=time, frame=one.frame.with_fields(exposure=exposure)))
    fit = refit_sequence(made, FrameFitter(optics, "linear"))
    assert np.allclose([r.velocity[1] for r in fit.records], speed, atol=5e-3)
    assert fit.separation[0] == pytest.approx(5.0, abs=1e-5)


def test_a_streak_too_short_to_see_loses_no_frame(optics, rng):
    fit = refit_sequence(
        exposures(optics, 12, rng, loci=[Linear.of(0.0)] * 12), FrameFitter(optics, "linear")
    )
    assert len(fit.summaries) >= 11  # 18 % were lost before
    assert abs(fit.separation[0] - 5.0) < 4 * fit.separation[1]


def test_the_error_is_that_of_one_dense_fisher_matrix_of_all_frames(optics):
    # 7 shared and 3 x 9 own parameters, slopes by central differences of images: no elimination, no filter
    optics = replace(optics, colours=Colours(wavelength_err=0.0))
    loci = [Mvn.of(0.15, 0.05, angle) for angle in (10.0, 70.0, 130.0)]
    scenes = {"x": np.array([0.1, -0.3, 0.2]), "y": np.array([0.0, 0.2, -0.2])}
    frames = exposures(optics, 3, None, loci=loci, scenes=scenes)
    shared = {"separation": 1e-4, "theta": 1e-3, "contrast": 1e-4, "noll7": 0.01, "noll8": 0.01}
    shared |= dict.fromkeys(Binary.colours, 0.1)
    own = {"x": 1e-4, "y": 1e-4, "flux": 10.0, "mvn_xx": 1e-5, "mvn_xy": 1e-5, "mvn_yy": 1e-5}
    own |= dict.fromkeys(("background", *GRADIENT), 1e-3)
    information = np.zeros((34, 34))
    information[[5, 6], [5, 6]] = optics.colours.sigma**-2
    for i, locus in enumerate(loci):
        scene = {name: float(getattr(SCENE, name)) for name in Binary.own}
        scene |= {name: float(values[i]) for name, values in scenes.items()}
        known = (
            scene
            | dict(zip(locus.names, np.asarray(locus.coords), strict=True))
            | dict.fromkeys(("noll7", "noll8", "background", *GRADIENT, *Binary.colours), 0.0)
        )

        def image(values):
            parts = [values[name] for name in locus.names]  # noqa: B023 (called within its turn of the loop)
            state = np.array([values["noll7"], values["noll8"]])
            colours = [values[name] for name in Binary.colours]
            binary = Binary(**{name: values[name] for name in Binary.own}, indices=colours)
            sky = {"background": values["background"], "gradient": [values[name] for name in GRADIENT]}
            truth = Parameters(binary, Mvn(jnp.array(parts)), state, **sky)
            return np.asarray(expected_image(truth, optics.otf(state, derivatives=False)))

        slopes = np.zeros((34, *optics.grid.shape))
        slots = [*range(7), *range(7 + 9 * i, 16 + 9 * i)]
        for slot, (name, step) in zip(slots, (shared | own).items(), strict=True):
            ends = [image({**known, name: known[name] + sign * step}) for sign in (1, -1)]
            slopes[slot] = (ends[0] - ends[1]) / (2 * step)
        information += np.einsum("iyx,jyx,yx->ij", slopes, slopes, 1 / image(known))
    scale = 1 / np.sqrt(np.diag(information))
    errors = scale * np.sqrt(np.diag(np.linalg.inv(information * np.outer(scale, scale))))
    fit = refit_sequence(frames, FrameFitter(optics), SequenceOptions({"aberrations": Constant()}))
    found = [fit.combined.error(name) for name in shared]
    # differences are good to the square of a step over the resolution; the prior of the filter to 1e-6
    assert np.allclose(found, errors[:7], rtol=1e-4)


@pytest.mark.parametrize(
    ("theta", "near", "counted", "flipped"),
    [
        (10.0, 12.0, 10.0, False),
        (185.0, 12.0, 5.0, True),
        (359.0, 2.0, -1.0, False),
        (80.0, 400.0, 440.0, False),
    ],
)
def test_stars_are_named_and_directions_counted_as_in_another_frame(theta, near, counted, flipped):
    values = {"theta": theta, "contrast": 1.1, "flux": 7.0}
    found = _alike(values, {"theta": near, "contrast": 1.05})
    assert found == pytest.approx({"theta": counted, "contrast": 1 / 1.1 if flipped else 1.1, "flux": 7.0})


def test_a_record_keeps_the_remarks_of_calibration_and_fit_but_for_what_all_share():
    frame = Frame(np.zeros((4, 4)), 0.0, flags=("masked", "saturated"))
    fit = FitResult(Status.OK, "", flags=("aberrations_held", "saturated", "misfit"))
    record = record_of(Exposure("frame", 0.0, frame), fit, ())
    assert record.flags == ("masked", "saturated", "misfit")
    held = record_of(Exposure("frame", 0.0, frame), fit, (), of_all=("aberrations_held",))
    assert held.flags == ("masked", "saturated", "misfit", "aberrations_held")


@pytest.mark.parametrize(("known", "held"), [((), True), (("noll4",), False)])
def test_what_a_symmetric_pupil_does_not_show_is_held_by_a_sequence_and_said(known, held, telescope):
    pupil = obstructed_circle(0.125, 0.04, noll=(4, 7), samples=64)  # its own mirror image
    fitter = FrameFitter(replace(telescope, pupil_from=lambda: pupil).system(), known=known)
    assert "noll4" not in fitter.shared
    assert fitter.flags == ("aberrations_held",) * held


@pytest.mark.parametrize(
    ("focus", "hot", "shown"), [(0.0, 0.0, ()), (20.0, 0.0, ("noll4",)), (20.0, 5e3, ("noll4",))]
)
def test_a_focus_that_only_its_square_shows_is_shared_where_frames_show_it(focus, hot, shown, telescope):
    """Images are direct sums; held at zero, 20 nm of focus made moments wrong by 14 errors.

    A pixel that stands out alone hides it from no frame.
    """
    pupil = obstructed_circle(0.125, 0.04, noll=(4, 7), samples=64)
    fitter = FrameFitter(replace(telescope, pupil_from=lambda: pupil).system(), scene="binary")
    x, y = pupil_places()
    opd = focus * np.sqrt(3) * (2 * (x**2 + y**2) - 1)
    frames = []
    for i in range(3):
        places = ((-2.5 + 0.1 * i, 0.4, 2e5), (2.5 + 0.1 * i, 0.4, 1e5))
        pixels = 2.0 + sum(star_image(*place, [(0.0, 0.0, 1.0)], opd=opd) for place in places)
        pixels[24, 26] += hot
        frame = Frame(pixels, 9.0, exposure=STEP, plate_scale=0.375)
        frames.append(Exposure(f"frame {i}", (i + 0.5) * STEP, frame))
    assert fitter.seeing(one.frame for one in frames).shown == shown
    fit = refit_sequence(frames, fitter)
    value, error = fit.separation
    assert abs(value - 5.0) < 0.1 * error
    for record in fit.records:
        assert ("sign_unknown" in record.flags, "aberrations_held" in record.flags) == (
            bool(shown),
            not shown,
        )
        assert np.all(np.abs(record.moments) < 0.3 * record.moment_errors)
    if shown:
        assert abs(fit.combined.value("noll4")) == pytest.approx(focus, rel=0.02)


def test_astigmatism_shows_beside_a_focus_and_is_shared_too(telescope):
    """Held, 1.2 nm of it made a covariance of the jitter wrong by two errors, in every frame alike."""
    pupil = obstructed_circle(0.125, 0.04, noll=(4, 5, 7), samples=64)
    optics = replace(telescope, pupil_from=lambda: pupil).system()
    state = np.array([20.0, 1.2, 0.0])
    scene = {"scenes": {"flux": [2e5] * 2}, "loci": [Mvn.of(0.05)] * 2, "states": [state] * 2}
    frames = exposures(optics, 2, None, **scene)
    fit = refit_sequence(frames, FrameFitter(optics, scene="binary"))
    assert {"noll4", "noll5"} <= set(fit.combined.names)
    for record in fit.records:
        assert np.all(np.abs(record.moments - [0.05**2, 0.0, 0.05**2]) < 0.1 * record.moment_errors)


def test_a_frame_that_is_searched_anew_has_the_signs_of_the_others(telescope):
    pupil = obstructed_circle(0.125, 0.04, noll=(4, 7), samples=64)
    optics = replace(telescope, pupil_from=lambda: pupil).system()
    state = np.array([20.0, 0.0])
    (one,) = exposures(optics, 1, None, loci=[Mvn.of(0.05)], states=[state])
    fitter = FrameFitter(optics, scene="binary", shown=("noll4",))
    first, _ = fitter.fit_first(one.frame, None)
    values = fitter.values_of(first.parameters)
    for sign in (1.0, -1.0):
        near = values | {"noll4": sign * 20.0}
        fit, _ = fitter.fit_first(one.frame, None, near)
        assert fit.status is Status.OK
        assert float(fit.parameters.aberrations[0]) == pytest.approx(sign * 20.0, abs=0.1)


@pytest.mark.slow
def test_what_is_known_of_the_colours_counts_once(telescope, rng):
    """Frames too faint to show a colour leave it as it is known, however many they are."""
    optics = replace(telescope, colours=Colours((0.4, 0.9), 0.3)).system()
    scene = Binary(5.0, 30.0, 0.0, 0.0, 3e3, 2.5, indices=[0.4, 0.9])
    made = []
    for i in range(6):
        image = np.asarray(expected_image(Parameters(scene, Mvn.of(0.1), np.zeros(2)), optics.nominal))
        frame = Frame(rng.poisson(image).astype(float), 0.0, exposure=STEP, plate_scale=0.375)
        made.append(Exposure(f"frame {i}", (i + 0.5) * STEP, frame))
    joint = refit_sequence(made, FrameFitter(optics, known=("noll7", "noll8"), scene="binary"))
    names, errors = joint.combined.names, np.sqrt(np.diag(joint.combined.covariance))
    slots = [names.index(name) for name in Binary.colours]
    np.testing.assert_allclose(errors[slots], 0.3, rtol=0.1)  # 1.8e4 photons tell a little
    np.testing.assert_allclose(joint.combined.values[slots], [0.4, 0.9], atol=0.3)


@pytest.mark.parametrize(("error", "shown"), [(0.0, False), (0.006, True)])
def test_what_the_residuals_of_the_last_pass_have_in_common_is_seen(optics, rng, error, shown):
    # an error of the flat field of 0.6 % adds 2e6 x 3.6e-5 = 72 to the chi-squared of a frame, of 2,100: one
    # sigma; to that of the stack of 12 frames 12 times as much
    flat = 1 + error * rng.standard_normal((48, 44))
    frames = [
        one._replace(
            frame=replace(one.frame, electrons=rng.poisson(one.frame.electrons * flat).astype(float))
        )
        for one in exposures(optics, 12, None)
    ]
    latest, passes = LatestPass(0.375), []

    def keep(number, frame, fit):
        passes.append(number)
        latest.add(number, frame, fit)

    fit = refit_sequence(frames, FrameFitter(optics), keep=keep)
    stack = most_stacked(latest.stacks)
    assert sorted(set(passes)) == list(range(1, fit.passes + 1))
    assert stack.frames == 12
    found = joint_summary(fit, stack=stack)["fit"]
    assert found["stack_frames"] == 12
    assert (found["structure_sigmas"] > 5) == shown
    assert abs(found["structure_sigmas"]) < 4 or shown
    assert ("stacked residual" in describe_run_fit(found)) == shown
    if (
        shown
    ):  # 0.2 errors of a frame for each root of the chi-squared that all have: of 72, less what is fitted
        frame_error = fit.separation[1] * np.sqrt(12)
        assert 6.5 < found["may_hide"] / (0.2 * frame_error) < 9.5
