import numpy as np
import pytest
from astropy import units

from jitterkit.motion import Line, PowerSpectrum, Record, assess_motion, split_line
from jitterkit.report.motion_table import motion_sentences, motion_table

LINES = (Line(61.0, 0.02, 90.0), Line(0.1, 0.05, 20.0), Line(4.0, 0.01, 20.0, 0.005))
MOTION = PowerSpectrum([1.0, 900.0], [[1e-6, 2e-7, 2e-6], [1e-10, 2e-11, 2e-10]], LINES)


def test_a_table_has_a_row_a_source_with_units_and_the_whole_last():
    assessed = assess_motion(MOTION, 0.1, cadence=0.3)
    table = motion_table(assessed)
    assert list(table["source"]) == ["random"] * 3 + ["line"] * 3 + ["all"]
    assert list(table["locus"])[3:] == ["linear", "path", "shm", "smear*path*shm"]
    row = table[-2]
    assert (row["from"], row["amplitude"], row["angle"]) == (
        61 * units.Hz,
        0.02 * units.arcsec,
        90 * units.deg,
    )
    moments = split_line(LINES[0], 0.1).jitter
    assert row["jitter_y"].to_value("arcsec") == pytest.approx(np.sqrt(moments[2]), rel=1e-5)
    assert row["jitter_x"].to_value("mas") == 0  # not 1e-15
    for name in ("displacement_sxy", "smear_syy", "jitter_sxx"):
        column = table[name].to_value("arcsec2")
        assert column[-1] == pytest.approx(column[:-1].sum(), rel=1e-9)
    assert (table.meta["exposure"], table.meta["cadence"], table.meta["bandwidth"]) == (0.1, 0.3, None)
    assert table.meta["between_frames"] == pytest.approx(list(assessed.steps))


def tells(said, *values):
    """Whether one of the sentences has all the values."""
    return any(all(value in sentence for value in values) for sentence in said)


def test_sentences_say_regime_and_locus_of_each_source():
    said = motion_sentences(assess_motion(MOTION, 0.1), 0.375)
    assert tells(said[:1], "0.1 s", "10 Hz")
    assert tells(said, "2 to 30 Hz", "medium", "smear")
    assert tells(said, "61 Hz, 0.020 arcsec", "high", "6.1 cycles", "shm")
    assert tells(said, "4 Hz, 0.010 x 0.0050 arcsec", "medium", "0.4 cycles", "path")
    assert "mvn" in said[-1]


@pytest.mark.parametrize(
    ("motion", "size", "off"),
    # noise-free fits on TOLIMAN: 11.3 µas at the worst phase of half a cycle of 56 mas, 1.4 of 28 mas
    [
        (PowerSpectrum(lines=(Line(61.0, 1.0), Line(0.1, 0.1))), 56e-3, None),
        (PowerSpectrum(lines=(Line(5.0, 1.0),)), 56e-3, 10),
        (PowerSpectrum(lines=(Line(5.0, 1.0),)), 28e-3, 1),
        (PowerSpectrum(lines=(Line(5.0, 1.0),)), 14e-3, None),
        (PowerSpectrum(lines=(Line(5.0, 1.0, 0.0, 0.01),)), 56e-3, 10),
        (PowerSpectrum([5.0, 15.0], [[1.0, 0, 0]] * 2), 56e-3, 10),
        # half a cycle an exposure, from crossing to crossing: jitter alone, and as lopsided as can be
        (Record(np.linspace(0, 5, 501), np.sin(np.linspace(0, 50 * np.pi, 501)), np.zeros(501)), 56e-3, 10),
    ],
)
def test_a_small_blur_is_normal_frame_by_frame_only_where_no_piece_is_lopsided(motion, size, off):
    assessed = assess_motion(motion, 0.1)
    # in pixels, as a blur of this size is on TOLIMAN
    pixel = 0.375 / size * np.sqrt(assessed.split.blur[0])
    last = motion_sentences(assessed, pixel)[-1]
    assert "mvn" in last
    assert "µas" not in last if off is None else f" {off} µas" in last


def test_a_line_without_amplitude_blurs_nothing():
    said = motion_sentences(assess_motion(PowerSpectrum(lines=(Line(5.0, 0.0),)), 0.1), 0.375)
    assert "stable" in said[-1]
    assert tells(said, "5 Hz, 0 arcsec", "medium", "0.5 cycles", "stable")


def test_a_wide_blur_is_not_called_a_normal_one():
    wide = assess_motion(PowerSpectrum(lines=(Line(61.0, 1.0),)), 0.1)
    assert "mvn" not in motion_sentences(wide, 0.375)[-1]
    assert tells(motion_sentences(wide, 0.375)[-1:], "shm", "707 × 0 mas", " 0°")


def test_what_a_loop_leaves_is_said():
    # at its bandwidth it leaves half the power: 14.1 of 20 mas
    said = motion_sentences(
        assess_motion(PowerSpectrum(lines=(Line(1e4 + 1, 0.02),)), 1.0, bandwidth=1e4 + 1), 0.375
    )
    assert tells(said, "10001 Hz", "10.0 mas of 14.1 mas")


def test_a_short_record_is_qualified():
    told = []
    for exposures in (5, 500):
        t = np.linspace(0, 0.1 * exposures, 40 * exposures)
        record = Record(t, 0.02 * np.sin(10 * t), np.zeros_like(t))
        said = motion_sentences(assess_motion(record, 0.1), 0.375)
        told += [one.removeprefix(f"{exposures} ") for one in said if one.startswith(f"{exposures} ")]
    short, long = told
    assert short.startswith(long.rstrip("."))
    assert short != long


def test_a_vibration_that_samples_hardly_follow_is_said_and_a_drift_is_not():
    t = np.arange(4000) / 1000
    fast = assess_motion(Record(t, 0.1 * np.sin(2 * np.pi * 203 * t), 0 * t), 0.1)
    # straight lines through samples of a sine have (2 + cos) / 3 of its mean square, by the phase of a step
    assert fast.lost == pytest.approx(1 - (2 + np.cos(2 * np.pi * 0.203)) / 3, rel=0.01)
    assert tells(motion_sentences(fast, 0.375), "straight", "24 %")
    slow = assess_motion(Record(t[::20], 5 * t[::20], 0 * t[::20]), 0.1)  # five samples an exposure
    assert slow.lost < 1e-6
    assert not tells(motion_sentences(slow, 0.375), "straight")
