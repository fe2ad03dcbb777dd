"""The order, the times and the duplicates of the frames of a sequence, without any fit."""

import shutil

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.batch import FileExposures
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import Frame, write_tiff
from jitterkit.refit import Status

EXPOSURE = 0.5


class Plain:
    """A processor that takes pixels for electrons; all frames have one optics."""

    plate_scale = 1.0

    def calibrate(self, raw):
        about = {"path": raw.path, "index": raw.index, "several": raw.several, "digest": raw.digest}
        exposure = raw.metadata.value("exposure", EXPOSURE)
        return Frame(raw.data, 1.0, exposure=exposure, metadata=raw.metadata, **about)

    def optics(self, frame):
        return "optics"


@pytest.fixture
def write(tmp_path):
    def write(name, seconds=None, seed=0, planes=None, **cards):
        shape = (4, 4) if planes is None else (planes, 4, 4)
        values = np.random.default_rng([seed, *name.encode()]).integers(0, 999, shape).astype(np.int16)
        header = fits.Header(cards)
        if seconds is not None:
            header["DATE-OBS"] = f"2027-03-01T03:00:{seconds:06.3f}"
        (tmp_path / name).parent.mkdir(exist_ok=True)
        fits.writeto(tmp_path / name, values, header)

    return write


def gone_over(directory, **options):
    exposures = FileExposures([directory], Plain(), **options)
    first, second = list(exposures), list(exposures)
    said = [[(e.name, e.problem and e.problem.message) for e in frames] for frames in (first, second)]
    assert said[0] == said[1]
    np.testing.assert_equal([e.time for e in first], [e.time for e in second])
    return exposures, first


@pytest.mark.parametrize("day", ["2027-03-01", "01/03/97"])
def test_days_without_a_time_are_no_times(day, write, tmp_path):
    for n in (1, 2, 10):
        write(f"f{n}.fits", **{"DATE-OBS": day})
    exposures, frames = gone_over(tmp_path)
    assert not exposures.timed
    assert [e.name for e in frames] == ["f1.fits", "f2.fits", "f10.fits"]
    np.testing.assert_allclose([e.time for e in frames], [0.25, 0.75, 1.25])


def test_times_in_different_scales_and_keywords_are_one_clock(write, tmp_path):
    """TT is 69.184 s, TAI 37 s ahead of UTC; MJD 61465.125 is 3 h on 2027-03-01."""
    write("a.fits", **{"DATE-OBS": "2027-03-01T03:01:12.184", "TIMESYS": "TT"})
    write("b.fits", **{"MJD-OBS": 61465.125})
    write("c.fits", **{"DATE-OBS": "2027-03-01T03:00:38.5", "TIMESYS": "TAI"})
    write("d.fits", **{"DATE-OBS": "2027-03-01", "UT": "03:00:02"})
    _, frames = gone_over(tmp_path)
    assert [e.name for e in frames] == ["b.fits", "c.fits", "d.fits", "a.fits"]
    np.testing.assert_allclose([e.time for e in frames], [0.25, 1.75, 2.25, 3.25], atol=2e-3)


def test_frames_come_in_the_order_of_their_times(write, tmp_path):
    times = {"f1.fits": 7.0, "f2.fits": 1.0, "f10.fits": 2.5, "z.fits": 1.5}
    for name, seconds in times.items():
        write(name, seconds)
    exposures, frames = gone_over(tmp_path)
    assert exposures.timed
    assert [e.name for e in frames] == ["f2.fits", "z.fits", "f10.fits", "f1.fits"]
    np.testing.assert_allclose([e.time for e in frames], [0.25, 0.75, 1.75, 6.25], atol=1e-9)


def test_frames_without_times_come_in_the_natural_order_of_their_names(write, tmp_path):
    for name in ("f10.fits", "f2.fits", "f1.fits", "e.fits", "f.fits", "f2b.fits"):
        write(name)
    exposures, frames = gone_over(tmp_path)
    assert not exposures.timed
    assert [e.name for e in frames] == ["e.fits", "f.fits", "f1.fits", "f2.fits", "f2b.fits", "f10.fits"]
    np.testing.assert_allclose(np.diff([e.time for e in frames]), EXPOSURE)


def test_a_frame_without_a_time_among_others_is_left_out_with_a_reason(write, tmp_path):
    for name, seconds in {"a.fits": None, "b.fits": 2.0, "c.fits": 1.0}.items():
        write(name, seconds)
    _, frames = gone_over(tmp_path)
    assert [e.name for e in frames] == ["c.fits", "b.fits", "a.fits"]
    assert [e.frame is None for e in frames] == [False, False, True]
    assert "--cadence" in frames[-1].problem.message


def test_with_a_cadence_such_frames_count_in_the_order_of_their_names(write, tmp_path):
    for name, seconds in {"a10.fits": None, "a2.fits": 5.0, "a1.fits": 9.0}.items():
        write(name, seconds)
    exposures, frames = gone_over(tmp_path, cadence=3.0)
    assert exposures.timed
    assert [e.name for e in frames] == ["a1.fits", "a2.fits", "a10.fits"]
    np.testing.assert_allclose([e.time for e in frames], [0.25, 3.25, 6.25])


def test_equal_times_come_in_the_order_of_names_and_a_cadence_separates_them(write, tmp_path):
    for name in ("f10.fits", "f9.fits"):
        write(name, 4.0)
    write("f11.fits", 3.0)
    _, frames = gone_over(tmp_path, cadence=2.0)
    assert [e.name for e in frames] == ["f11.fits", "f9.fits", "f10.fits"]
    np.testing.assert_allclose([e.time for e in frames], [0.25, 2.25, 4.25])


def test_the_mean_time_of_an_exposure_is_its_middle(write, tmp_path):
    """Zero is the beginning of the first exposure, as telemetry counts, whichever card there is."""
    write("a.fits", **{"DATE-AVG": "2027-03-01T03:00:01.250"})
    write("b.fits", seconds=2.0)
    _, frames = gone_over(tmp_path)
    np.testing.assert_allclose([e.time for e in frames], [0.25, 1.25], atol=1e-9)


def test_zero_is_the_beginning_of_a_first_exposure_that_is_of_no_use(write, tmp_path, monkeypatch):
    """Telemetry counts from it, whether it can be calibrated or not."""

    def calibrate(self, raw, usual=Plain.calibrate):
        if raw.name == "f0.fits":
            raise FrameError(ErrorCode.WRONG_INSTRUMENT, raw.path, "is of another camera", "leave it out")
        return usual(self, raw)

    monkeypatch.setattr(Plain, "calibrate", calibrate)
    for number in range(3):
        write(f"f{number}.fits", 1.0 + number)
    _, frames = gone_over(tmp_path)
    np.testing.assert_allclose([e.time for e in frames], [np.nan, 1.25, 2.25])


def test_a_duplicate_is_passed_on_without_pixels_and_takes_no_time(write, tmp_path):
    write("a.fits")
    shutil.copy(tmp_path / "a.fits", tmp_path / "b.fits")
    write("c.fits")
    with fits.open(tmp_path / "c.fits") as hdus:
        plane = hdus[0].data
    fits.writeto(tmp_path / "d.fits", np.stack([plane + 1, plane, plane + 1]).astype(np.int32))
    _, frames = gone_over(tmp_path)
    assert [e.frame is None for e in frames] == [False, True, False, False, True, True]
    originals = {1: "a.fits [0]", 4: "c.fits [0]", 5: "d.fits [0]"}
    for position, name in originals.items():
        assert frames[position].problem.status is Status.DUPLICATE
        assert str(tmp_path / name) in frames[position].problem.message
    times = [e.time for e in frames if e.frame is not None]
    np.testing.assert_allclose(times, [0.25, 0.75, 1.25])


OVERLAPS = [  # times of files with exposures of 0.5 s, planes of each, cadence, what is said
    ((1.0, 1.5, 2.0), None, None, ""), ((1.0, 1.46, 1.92), None, None, ""),  # a shutter takes 0.04 s
    ((1.0, 1.3, 1.6), None, None, "f1.fits begins 0.2 s before f0.fits ends, and 1 more"),
    ((1.0, 1.3, 1.6), None, 0.5, ""),
    ((None, None), None, 0.3, "f1.fits begins 0.2 s before f0.fits ends: the"),
    ((None, None), None, None, ""), ((1.0, 2.5), 3, None, ""),
    ((1.0, 2.1), 3, None, "f1.fits[0] begins 0.4 s before f0.fits[2] ends: the times"),
    ((1.0, 2.0), 3, None, ""), ((1.0, 2.0), 5, None, "f1.fits[0] begins 1.5 s before f0.fits[4] ends"),
]  # fmt: skip


@pytest.mark.parametrize(("times", "planes", "cadence", "said"), OVERLAPS)
def test_exposures_that_overlap_are_said(times, planes, cadence, said, write, tmp_path):
    """Of whole seconds the times may be a second off: 3 planes of 0.5 s fit between 1 and 2 s."""
    for number, seconds in enumerate(times):
        write(f"f{number}.fits", seconds, planes=planes)
    exposures, _ = gone_over(tmp_path, cadence=cadence)
    assert exposures.overlap.startswith(said) if said else not exposures.overlap


DATES = {  # of files f0, f1, ...; what is said
    "a date that stays at midnight": (
        ["01T23:59:58", "01T23:59:59", "01T00:00:00"],
        "f2.fits was taken 24 hours",
    ),
    "midnight": (["01T23:59:58", "01T23:59:59", "02T00:00:00"], ""),
    "two nights": (["01T03:00:00", "01T03:00:01", "02T03:00:00"], ""),
    "names in another order": (["01T03:00:02", "01T03:00:00", "01T03:00:01"], ""),
}


@pytest.mark.parametrize("case", DATES)
def test_a_clock_that_jumps_against_the_order_of_the_names_is_said(case, write, tmp_path):
    dates, said = DATES[case]
    for number, date in enumerate(dates):
        write(f"f{number}.fits", **{"DATE-OBS": f"2027-03-{date}"})
    jump = gone_over(tmp_path)[0].jump
    assert said in jump if said else not jump


def test_copies_and_the_detectors_of_one_camera_do_not_overlap(write, tmp_path):
    for number in range(2):
        date = {"DATE-OBS": f"2027-03-01T03:00:0{0.6 * number:.1f}"}
        chips = [fits.ImageHDU(np.full((4, 4), 10 * number + n, np.int16), name="SCI", ver=n) for n in (1, 2)]
        hdus = fits.HDUList([fits.PrimaryHDU(header=fits.Header(date)), *chips])
        hdus.writeto(tmp_path / f"c{number}.fits")
        shutil.copy(tmp_path / f"c{number}.fits", tmp_path / f"copy{number}.fits")
    exposures, frames = gone_over(tmp_path)
    assert sum(e.frame is not None for e in frames) == 4
    assert not exposures.overlap


def test_images_of_one_file_have_the_times_of_their_own_headers(write, tmp_path):
    """Seconds 1, 4 (two planes) and 9 after the minute, in one file; 6 in another."""
    images = [fits.PrimaryHDU()]
    for number, (seconds, planes) in enumerate([(1, 1), (4, 2), (9, 1)]):
        values = np.arange(16 * planes, dtype=np.int16).reshape(planes, 4, 4) + 50 * number
        header = fits.Header({"DATE-OBS": f"2027-03-01T03:00:0{seconds}"})
        images.append(fits.ImageHDU(values, header, name="SCI", ver=number + 1))
    fits.HDUList(images).writeto(tmp_path / "many.fits")
    exposures, frames = gone_over(tmp_path)
    np.testing.assert_allclose([e.time for e in frames], [0.25, 3.25, 3.75, 8.25])
    assert not exposures.overlap
    assert exposures.unbroken
    write("next.fits", seconds=9.2)
    assert gone_over(tmp_path)[0].overlap.startswith("next.fits begins 0.3 s before many.fits[3] ends")


@pytest.mark.parametrize(
    ("seconds", "exposure", "middles"),
    [
        ([1, 1, 1, 1, 2, 2], 0.25, [0.125, 0.375, 0.625, 0.875, 1.125, 1.375]),  # whole seconds
        (
            [1, 1, 6, 6],
            0.5,
            [0.25, 0.75, 5.25, 5.75],
        ),  # two detectors, which are modelled one after the other
    ],
)
def test_images_that_share_a_time_of_their_own_follow_each_other(seconds, exposure, middles, tmp_path):
    images = [fits.PrimaryHDU()]
    for number, second in enumerate(seconds):
        header = fits.Header({"DATE-OBS": f"2027-03-01T03:00:0{second}", "EXPTIME": exposure})
        values = np.arange(16, dtype=np.int16).reshape(4, 4) + 50 * number
        images.append(fits.ImageHDU(values, header, name="SCI", ver=number + 1))
    fits.HDUList(images).writeto(tmp_path / "many.fits")
    exposures, frames = gone_over(tmp_path)
    np.testing.assert_allclose([e.time for e in frames], middles)
    assert exposures.unbroken


def test_frames_without_times_follow_each_other_however_long_each_is(write, tmp_path):
    for number, exposure in enumerate([1.0, 2.0, 3.0]):
        write(f"f{number}.fits", EXPTIME=exposure)
    np.testing.assert_allclose([e.time for e in gone_over(tmp_path)[1]], [0.5, 2.0, 4.5])


@pytest.mark.parametrize(("planes", "cadence", "said"), [(3, None, True), (3, 2.0, False), (1, None, False)])
def test_planes_without_times_of_their_own_are_said_to_follow_each_other(
    planes, cadence, said, write, tmp_path
):
    write("cube.fits", seconds=1.0, planes=planes)
    assert gone_over(tmp_path, cadence=cadence)[0].unbroken == said


def test_times_with_and_without_a_zone_are_one_clock(tmp_path):
    """Beside a TIFF the time is what its owner wrote; two hours east of Greenwich it is two hours earlier."""
    for name, time in {
        "a": "2027-03-01T05:00:02+02:00",
        "b": "2027-03-01T03:00:01Z",
        "c": "2027-03-01T03:00:03",
    }.items():
        write_tiff(tmp_path / f"{name}.tif", np.full((4, 4), ord(name), np.uint16))
        (tmp_path / f"{name}.toml").write_text(f'time = "{time}"\n')
    exposures = FileExposures([tmp_path], Plain())
    assert [path.stem for path in exposures.files] == ["b", "a", "c"]
    assert [exposure.time for exposure in exposures] == pytest.approx([0.25, 1.25, 2.25])
