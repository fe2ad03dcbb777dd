"""Instrument files: what they say, and the sentence when they say it wrong."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import write_fits
from jitterkit.instruments import load_instrument, read_instrument
from jitterkit.instruments.description import describe_instrument
from jitterkit.instruments.toml import SECTIONS
from jitterkit.optics import Colours, Pupil, flat_band
from jitterkit.optics.pupil_file import write_pupil

WHOLE = """
[instrument]
name = "testbed"
plate_scale = 0.3
plate_scale_err = 2e-5
shape = [40, 60]
exposure = 0.2
flux = 2e5
[telescope]
diameter = 0.1
obscuration = 0.03
struts = 4
strut_width = 0.002
noll = [4, 7]
samples = 64
[spectrum]
band = [500, 600]
samples = 5
[detector]
gain = 1.5
read_noise = 3
bias = 100
full_well = 20000
saturation = 60000
bits = 16
"""
LEAST = "[instrument]\nplate_scale = 0.3\n[telescope]\ndiameter = 0.1\n[spectrum]\nlines = [633]\n"


@pytest.fixture
def toml(tmp_path):
    def write(text, name="bed.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_whole_file_is_understood(toml):
    bed = read_instrument(toml(WHOLE))
    assert (bed.name, bed.plate_scale, bed.shape, bed.exposure, bed.flux) == (
        "testbed",
        0.3,
        (40, 60),
        0.2,
        2e5,
    )
    assert bed.spectrum == flat_band(500, 600, 5)
    assert bed.aberrations == ("noll4", "noll7")
    assert (bed.pupil.diameter, bed.pupil.transmission.shape) == (0.1, (64, 64))
    clear = np.pi / 4 * (0.1**2 - 0.03**2) - 4 * 0.002 * 0.035
    area = bed.pupil.transmission.sum() * bed.pupil.pitch**2
    assert area == pytest.approx(
        clear, rel=2e-3
    )  # 64 x 8 points across: edges are 1/500 of the area uncertain
    d = bed.detector
    numbers = (d.gain, d.read_noise, d.bias, d.full_well, d.saturation, d.bits)
    assert numbers == (1.5, 3.0, 100.0, 20000.0, 60000.0, 16)


def test_numbers_of_a_file_name_the_file_the_table_and_the_key(toml):
    bed = read_instrument(toml(WHOLE))
    assert bed.plate_scale_err == 2e-5
    assert bed.source("plate_scale") == "instrument file bed.toml [instrument] plate_scale"
    assert bed.detector.source("gain") == "instrument file bed.toml [detector] gain"


def test_what_is_known_of_aberrations_is_read_and_reported(toml):
    bed = read_instrument(toml(WHOLE.replace("exposure = 0.2", "exposure = 0.2\naberration_sigma = 5")))
    assert bed.aberration_sigma == 5.0
    row = ("aberration_sigma", "5", "nm", "instrument file bed.toml [instrument] aberration_sigma")
    assert row in describe_instrument(bed)
    assert "aberration_sigma" not in str(describe_instrument(read_instrument(toml(WHOLE))))
    with refused(ErrorCode.OUT_OF_RANGE, "aberration_sigma = -5", "nm"):
        read_instrument(toml(LEAST.replace("[telescope]", "aberration_sigma = -5\n[telescope]")))


def test_the_least_file_leaves_the_detector_unknown(toml):
    bed = read_instrument(toml(LEAST))
    assert (bed.name, bed.shape, bed.detector.gain) == ("bed", (128, 128), None)
    assert bed.spectrum.wavelengths == (633.0,)


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        ("[633]", "[633]", ""),
        ("[633]", "[6330]", "43.5 pixels"),
        ("= 0.3", "= 8.3e-5", "1.57e+04 pixels"),
        ("diameter = 0.1", "diameter = 100", "0.00435 pixels"),
    ],
)
def test_a_resolution_that_no_camera_samples_is_said(toml, caplog, was, becomes, said):
    """Angstroms, degrees and millimetres; 633 nm over 0.1 m are 1.306 arcsec."""
    read_instrument(toml(LEAST.replace(was, becomes)))
    assert [said in text and "units" in text for text in caplog.messages] == [True] * bool(said)


@pytest.mark.parametrize(
    ("diameter", "named"), [("80", ("80 m", "0.3 arcsec")), ("0.5", ("[telescope] samples",))]
)
def test_a_diameter_in_millimetres_is_not_answered_by_a_number_of_samples(toml, diameter, named):
    with refused(ErrorCode.SAMPLING, *named):
        read_instrument(toml(LEAST.replace("= 0.1", f"= {diameter}\nsamples = 64"))).system()


def test_a_base_fills_what_is_not_said_and_keeps_its_sources(toml):
    bed = read_instrument(toml('[instrument]\nbase = "smallsat"\nexposure = 2\n[detector]\ngain = 1.0\n'))
    base = load_instrument("smallsat")
    assert (bed.name, bed.exposure, bed.plate_scale) == ("bed", 2.0, base.plate_scale)
    assert (bed.detector.gain, bed.detector.read_noise) == (1.0, base.detector.read_noise)
    assert bed.detector.source("gain").startswith("instrument file bed.toml")
    assert bed.detector.source("read_noise").startswith("preset smallsat")
    assert bed.pupil_from is not None


def test_a_pupil_file_lies_beside_the_toml(toml, tmp_path, monkeypatch):
    write_pupil(tmp_path / "p.npz", Pupil(np.ones((16, 16)), 0.2))
    path = toml(LEAST.replace("diameter = 0.1", 'pupil = "p.npz"'))
    monkeypatch.chdir("/")
    assert read_instrument(path).pupil.diameter == 0.2
    both = toml(LEAST.replace("diameter = 0.1", 'pupil = "p.npz"\ndiameter = 0.3'), "both.toml")
    assert read_instrument(both).pupil.diameter == 0.3


def test_a_star_file_takes_the_place_of_telescope_and_spectrum(toml, tmp_path):
    star = np.outer(np.hanning(9), np.hanning(9)).astype(np.float32)
    write_fits(tmp_path / "star.fits", star)
    bed = read_instrument(toml('[instrument]\nplate_scale = 1.2\n[psf]\nfile = "star.fits"\n'))
    assert bed.pupil is None
    assert bed.psf == pytest.approx(star)
    based = read_instrument(toml('[instrument]\nbase = "smallsat"\n[psf]\nfile = "star.fits"\n'))
    assert based.optics(pad=4).pixel_included


def test_a_star_with_missing_pixels_is_refused(toml, tmp_path):
    star = np.ones((5, 5))
    star[2, 2] = np.nan
    write_fits(tmp_path / "star.fits", star)
    bed = read_instrument(toml('[instrument]\nplate_scale = 1.2\n[psf]\nfile = "star.fits"\n'))
    with refused(ErrorCode.MISSING_VALUE, tmp_path / "star.fits", "1 pixels"):
        bed.optics()


STAR = '[instrument]\nplate_scale = 1.2\n[psf]\nfile = "star.fits"\n'


def test_a_star_of_another_oversampling_than_its_header_says_is_refused(toml, tmp_path):
    write_fits(tmp_path / "star.fits", np.outer(np.hanning(9), np.hanning(9)), header={"OVERSAMP": 4})
    with refused(ErrorCode.CONFLICT, tmp_path / "star.fits", "OVERSAMP = 4", "[psf]", 1):
        read_instrument(toml(STAR)).optics()
    assert read_instrument(toml(STAR + "oversample = 4\n")).optics(pad=4).pixel_included


def test_a_star_in_a_cube_is_refused(toml, tmp_path):
    write_fits(tmp_path / "star.fits", np.stack([np.outer(np.hanning(9), np.hanning(9))] * 2))
    with refused(ErrorCode.WRONG_SHAPE, tmp_path / "star.fits", 2, error=FrameError):
        read_instrument(toml(STAR)).optics()


@pytest.mark.parametrize("header", [{}, {"SATURATE": 5e4}])
def test_a_saturated_star_is_refused(toml, tmp_path, header):
    """A normal star of 1e5 ADU, off the middle of a pixel, so that no two pixels are alike by symmetry."""
    y, x = np.mgrid[:25, :25] - 12.0
    star = np.rint(1e5 * np.exp(-((x - 0.2) ** 2 + (y - 0.37) ** 2) / 8))
    write_fits(tmp_path / "star.fits", np.minimum(star, 5e4), header=header)
    with refused(ErrorCode.OUT_OF_RANGE, tmp_path / "star.fits", 50000):
        read_instrument(toml(STAR)).optics()
    write_fits(tmp_path / "star.fits", star, overwrite=True)
    assert read_instrument(toml(STAR)).optics(pad=4).pixel_included


def test_bad_pixels_come_from_a_file(toml, tmp_path):
    bad = np.zeros((4, 6), np.uint8)
    bad[1, 2] = 1
    write_fits(tmp_path / "bad.fits", bad)
    bed = read_instrument(toml(LEAST + '[detector]\nbad_pixels = "bad.fits"\n'))
    assert np.argwhere(bed.detector.bad_pixels).tolist() == [[1, 2]]


def test_a_file_that_begins_with_a_byte_order_mark_is_read(toml):
    assert read_instrument(toml("\ufeff" + WHOLE)).name == "testbed"


def test_lines_may_be_weighted(toml):
    bed = read_instrument(toml(LEAST.replace("[633]", "[532, 633]\nweights = [1, 3]")))
    assert bed.spectrum.weights == (0.25, 0.75)


@pytest.mark.parametrize(
    ("was", "becomes", "code", "values"),
    [
        ("[telescope]", "[telescop]", ErrorCode.UNKNOWN_NAME, ("'telescop'", "'telescope'")),
        ("gain", "gian", ErrorCode.UNKNOWN_NAME, ("[detector] 'gian'", "'gain'", "read_noise")),
        ("plate_scale = 0.3", "", ErrorCode.MISSING_VALUE, ("[instrument]", "plate_scale", "arcsec/pixel")),
        (
            "plate_scale = 0.3",
            'plate_scale = "a"',
            ErrorCode.WRONG_TYPE,
            ("[instrument] plate_scale = 'a'", "arcsec/pixel"),
        ),
        (
            "plate_scale = 0.3",
            "plate_scale = true",
            ErrorCode.WRONG_TYPE,
            ("[instrument] plate_scale = True",),
        ),
        (
            "plate_scale = 0.3",
            "plate_scale = -0.3",
            ErrorCode.OUT_OF_RANGE,
            ("plate_scale = -0.3", "0 to 100000", "arcsec/pixel"),
        ),
        ("[40, 60]", "[40]", ErrorCode.WRONG_SHAPE, ("[instrument] shape = [40]",)),
        ("[40, 60]", "[40, 6.5]", ErrorCode.WRONG_TYPE, ("[instrument] shape = [40, 6.5]",)),
        ("[40, 60]", "[40, 0]", ErrorCode.WRONG_SHAPE, ("shape = [40, 0]",)),
        ('"testbed"', "5", ErrorCode.WRONG_TYPE, ("[instrument] name = 5",)),
        ('name = "testbed"', 'base = "smalsat"', ErrorCode.UNKNOWN_NAME, ("'smalsat'", "'smallsat'")),
        ("diameter = 0.1", "", ErrorCode.MISSING_VALUE, ("[telescope]", "diameter")),
        ("diameter = 0.1", "diameter = 0", ErrorCode.OUT_OF_RANGE, ("[telescope] diameter = 0;",)),
        ("diameter = 0.1", "diameter = inf", ErrorCode.OUT_OF_RANGE, ("[telescope] diameter = inf", "m")),
        ("diameter = 0.1", "diameter = 125", ErrorCode.OUT_OF_RANGE, ("[telescope] diameter = 125", "100 m")),
        ("[500, 600]", "[0.5, 0.6]", ErrorCode.OUT_OF_RANGE, ("10 and 1e+06 nm",)),
        ("[500, 600]", "[500, inf]", ErrorCode.OUT_OF_RANGE, ("[spectrum] band = [500, inf]", "nm")),
        ("diameter = 0.1", 'pupil = "no.npz"', ErrorCode.CONFLICT, ("[telescope] obscuration = 0.03",)),
        ("obscuration = 0.03", "obscuration = 0.3", ErrorCode.OUT_OF_RANGE, ("obscuration = 0.3;", "0.1.")),
        ("strut_width = 0.002", "strut_width = 2", ErrorCode.OUT_OF_RANGE, ("strut_width = 2;", "m", "0.1.")),
        ("strut_width = 0.002", "", ErrorCode.MISSING_VALUE, ("[telescope]", "strut_width")),
        ("struts = 4", "struts = 4.5", ErrorCode.WRONG_TYPE, ("[telescope] struts = 4.5",)),
        ("struts = 4", "struts = -4", ErrorCode.OUT_OF_RANGE, ("[telescope] struts = -4", "least 0")),
        ("noll = [4, 7]", "noll = [1, 7]", ErrorCode.OUT_OF_RANGE, ("noll = [1, 7]", "from 2")),
        ("noll = [4, 7]", "noll = [4, 4]", ErrorCode.DUPLICATE, ("noll = [4, 4]",)),
        ("band = [500, 600]", "", ErrorCode.MISSING_VALUE, ("[spectrum]", "band, lines, file")),
        ("samples = 5", "lines = [5]", ErrorCode.CONFLICT, ("[spectrum]", "band and lines")),
        ("samples = 5", "weights = [5]", ErrorCode.CONFLICT, ("[spectrum] weights = [5]", "band")),
        ("samples = 5", "samples = 0", ErrorCode.OUT_OF_RANGE, ("[spectrum] samples = 0", "least 1")),
        ("[500, 600]", "[600, 500]", ErrorCode.OUT_OF_RANGE, ("[spectrum] band = [600, 500]", "nm")),
        ("[500, 600]", "[500]", ErrorCode.WRONG_SHAPE, ("[spectrum] band = [500]", "[2]", "nm")),
        ("[500, 600]", '"V"', ErrorCode.WRONG_TYPE, ("[spectrum] band = 'V'", "[2]", "nm")),
        ("gain = 1.5", "gain = 0", ErrorCode.OUT_OF_RANGE, ("gain = 0.0", "e-/ADU")),
        ("bits = 16", "bits = 99", ErrorCode.OUT_OF_RANGE, ("bits = 99", "1 to 32")),
        (
            "bits = 16",
            'bad_pixels = "gone.fits"',
            ErrorCode.NOT_FOUND,
            ("[detector] bad_pixels = 'gone.fits'", "bed.toml"),
        ),
        ("[detector]", "[psf]\nfile = 'x'\n[detector]", ErrorCode.CONFLICT, ("[psf]", "[telescope]")),
        ("[detector]", "[detector", ErrorCode.MALFORMED, ("line 19",)),
    ],
)
def test_a_mistake_is_refused_in_one_line_with_file_key_and_value(toml, was, becomes, code, values):
    assert was in WHOLE
    path = toml(WHOLE.replace(was, becomes, 1))
    with refused(code, *values) as caught:
        read_instrument(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("detector = 3\n", ErrorCode.WRONG_TYPE, ("detector = 3", "[detector]")),
        ("[instrument]\nplate_scale = 1\n", ErrorCode.MISSING_VALUE, ("[telescope]", "[psf]")),
        (
            "[instrument]\nplate_scale = 1\n[telescope]\ndiameter = 1\n",
            ErrorCode.MISSING_VALUE,
            ("[spectrum]",),
        ),
        ("[instrument]\nplate_scale = 1\n[psf]\n", ErrorCode.MISSING_VALUE, ("[psf]", "file")),
    ],
)
def test_a_file_that_lacks_a_part_says_which(toml, text, code, values):
    path = toml(text)
    with refused(code, path, *values):
        read_instrument(path)


def test_a_missing_file_is_distinguished_from_a_missing_preset(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "gone.toml"):
        load_instrument(tmp_path / "gone.toml")
    with refused(ErrorCode.NOT_READABLE, tmp_path):
        load_instrument(str(tmp_path))


def test_a_star_on_a_pedestal_is_no_psf(tmp_path):
    from jitterkit.frames import write_fits
    from jitterkit.instruments.pupils import star

    y, x = np.mgrid[-10:11, -10:11]
    light = 1e4 * np.exp(-(x**2 + y**2) / 8)
    write_fits(tmp_path / "raw.fits", light + 300.0)
    with refused(ErrorCode.OUT_OF_RANGE, tmp_path / "raw.fits", 300.002):
        star(tmp_path / "raw.fits")
    write_fits(tmp_path / "biased.fits", light + 300.0, header={"BIASLVL": 300.0})
    np.testing.assert_allclose(star(tmp_path / "biased.fits"), light, atol=1e-9)


def test_a_star_of_eight_bits_is_no_psf(tmp_path):
    from jitterkit.instruments.pupils import star

    y, x = np.mgrid[-10:11, -10:11]
    light = np.exp(-(x**2 + y**2) / 8)
    write_fits(tmp_path / "bytes.fits", np.rint(255 * light).astype(np.uint8))
    with refused(ErrorCode.SAMPLING, tmp_path / "bytes.fits", 255):
        star(tmp_path / "bytes.fits")
    write_fits(tmp_path / "words.fits", np.rint(60000 * light).astype(np.uint16))
    np.testing.assert_allclose(star(tmp_path / "words.fits"), 60000 * light, atol=0.5)


def test_an_image_without_light_is_no_psf(tmp_path):
    from jitterkit.instruments.pupils import star

    write_fits(tmp_path / "star.fits", np.zeros((21, 21)))
    with refused(ErrorCode.OUT_OF_RANGE, tmp_path / "star.fits", 0):
        star(tmp_path / "star.fits")


@pytest.mark.parametrize(("level", "said"), [(5.0, True), (-5.0, True), (0.1, False)])
def test_a_background_left_under_a_star_is_said(level, said, tmp_path, caplog):
    """Over 21 x 21 pixels it sums to 441 levels."""
    from jitterkit.instruments.pupils import star

    y, x = np.mgrid[-10:11, -10:11]
    light = 1e3 * np.exp(-(x**2 + y**2) / 8)
    expected = 100 * 441 * level / light.sum()
    write_fits(tmp_path / "star.fits", light + level)
    star(tmp_path / "star.fits")
    assert bool(caplog.messages) == said
    if said:
        assert f"wrong by {expected:.0f} %" in caplog.messages[0]


@pytest.mark.parametrize("power", [3, 4, 5])
@pytest.mark.parametrize("whole", [True, False])
def test_the_wings_of_a_star_are_no_background_and_light_beyond_the_edge_is_said(
    power, whole, tmp_path, caplog
):
    """Of a Moffat profile (1 + r²/a²)^(-p/2), (1 + R²/a²)^(1-p/2) lies beyond the radius R."""
    from jitterkit.instruments.pupils import star

    y, x = np.mgrid[-20:21, -20:21]
    write_fits(tmp_path / "star.fits", 1e4 / (1 + (x**2 + y**2) / 4) ** (power / 2))
    beyond = 100 * (1 + 41**2 / np.pi / 4) ** (1 - power / 2)
    star(tmp_path / "star.fits", whole=whole)
    said = [float(text.split("about ")[1].split(" %")[0]) for text in caplog.messages]
    assert said == ([pytest.approx(beyond, rel=0.3)] if whole and beyond > 2 else [])


@pytest.mark.parametrize(
    ("header", "said"), [({"PIXELSCL": 0.075}, False), ({"PIXELSCL": 0.3}, True), ({}, False)]
)
def test_a_star_on_another_scale_than_the_instrument_files_is_said(header, said, toml, tmp_path, caplog):
    y, x = np.mgrid[-20:21, -20:21]
    write_fits(tmp_path / "star.fits", np.exp(-(x**2 + y**2) / 50), header=header)
    text = '[instrument]\nplate_scale = 0.3\n[psf]\nfile = "star.fits"\noversample = 4\n'
    read_instrument(toml(text)).psf_from()
    assert [("0.3 arcsec" in text, "0.075" in text) for text in caplog.messages] == [(True, True)] * said


def test_a_star_of_light_at_points_is_no_psf(tmp_path):
    """stpsf's image with four samples per pixel lacks 1/12 pix² of blur by the pixel."""
    from jitterkit.instruments.pupils import star

    write_fits(tmp_path / "stpsf.fits", np.outer(np.hanning(41), np.hanning(41)), header={"DET_SAMP": 4})
    with refused(ErrorCode.SAMPLING, tmp_path / "stpsf.fits", "DET_SAMP = 4", "jitterkit instrument"):
        star(tmp_path / "stpsf.fits")


@pytest.mark.parametrize(("section", "key"), [(name, key) for name, keys in SECTIONS.items() for key in keys])
def test_a_value_of_the_wrong_type_is_refused_by_section_key_and_unit(toml, tmp_path, section, key):
    write_fits(tmp_path / "star.fits", np.outer(np.hanning(9), np.hanning(9)))
    values = {
        "instrument": {"plate_scale": 0.3},
        "telescope": {"diameter": 0.1},
        "spectrum": {"lines": [633]},
    }
    if section == "psf":
        values = {"instrument": {"plate_scale": 0.3}, "psf": {"file": "star.fits"}}
    if key in ("pupil", "file", "band"):
        values[section] = {}
    if (section, key) == ("spectrum", "samples"):
        values[section] = {"band": [500, 600]}
    values.setdefault(section, {})[key] = {"a": 1}
    lines = []
    for name, table in values.items():
        lines += [
            f"[{name}]",
            *(f"{k} = {'{a = 1}' if isinstance(v, dict) else repr(v)}" for k, v in table.items()),
        ]
    text = "\n".join(lines)
    told_by_other_words = {"shape", "oversample"}
    unit = [SECTIONS[section][key]] if SECTIONS[section][key] and key not in told_by_other_words else []
    with refused(ErrorCode.WRONG_TYPE, f"[{section}] {key} = {{'a': 1}}", *unit):
        read_instrument(toml(text))


def test_an_oversampled_star_is_read_with_its_centre_and_share(toml, tmp_path):
    write_fits(tmp_path / "star.fits", np.outer(np.hanning(41), np.hanning(33)))
    head = '[instrument]\nplate_scale = 0.4\nshape = [9, 8]\n[psf]\nfile = "star.fits"\n'
    bed = read_instrument(toml(head + "oversample = 4\ncentre = [16, 20]\nenclosed = 0.9\n"))
    otf = bed.optics(pad=4)
    assert (otf.grid.refine, otf.grid.pitch) == (4, pytest.approx(0.1))
    assert float(otf.value[0, 0].real) == pytest.approx(0.9)
    assert abs(float(otf.value[0, 1].imag)) < 1e-12  # even about its centre
    for wrong in ("oversample = 0", "enclosed = 1.1", "enclosed = 0"):
        with refused(ErrorCode.OUT_OF_RANGE, f"[psf] {wrong.split(' =')[0]}"):
            read_instrument(toml(head + wrong + "\n"))
    with refused(ErrorCode.CONFLICT, "diffusion = 0.2", "PSF"):
        read_instrument(toml(head + "[detector]\ndiffusion = 0.2\n"))


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("", Colours()),
        ("indices = [0.3, 0.7]", Colours((0.3, 0.7))),
        ("indices = [0.3]\nindex_err = 0", Colours((0.3,), 0.0)),
        ("wavelength_err = 1e-4", Colours(wavelength_err=1e-4)),
        ("temperatures = [5790]\nindex_err = 1.5", Colours((0.0,), 1.5, 5790.0)),
    ],
)
def test_colours_are_read_as_indices_or_temperatures(toml, line, known):
    read = read_instrument(toml(WHOLE.replace("samples = 5", f"samples = 5\n{line}"))).colours
    assert replace(read, indices=known.indices) == known
    assert read.indices == pytest.approx(known.indices, abs=1e-12)


def two_files(folder, names='"a.csv", "b.csv"', extra=""):
    """Name files of stars whose photons rise and fall with the wavelength: of A, B, and A once more."""
    nm = np.linspace(500, 600, 201)
    for name, index in (("a", 0.1), ("b", -0.1), ("c", 0.1)):
        rows = [f"{at},{1 + index * (1 - 550 / at)}" for at in nm]
        (folder / f"{name}.csv").write_text("nm,photons\n" + "\n".join(rows), encoding="utf-8")
    return WHOLE.replace("band = [500, 600]", f"file = [{names}]\n{extra}")


def test_each_star_may_have_a_spectrum_from_a_file(toml, tmp_path):
    read = read_instrument(toml(two_files(tmp_path)))
    assert read.colours.indices == pytest.approx([0.1, -0.1], rel=1e-2)
    assert read.spectrum.wavelengths == pytest.approx(flat_band(500, 600, 5).wavelengths, abs=0.1)


@pytest.mark.parametrize(
    ("names", "extra", "code", "value"),
    [
        ('"a.csv", "b.csv"', "temperatures = [5000]", ErrorCode.CONFLICT, "temperatures"),
        ('"a.csv", "b.csv", "c.csv"', "", ErrorCode.WRONG_SHAPE, "file"),
        ('"a.csv", "none.csv"', "", ErrorCode.NOT_FOUND, "none.csv"),
    ],
)
def test_impossible_files_of_stars_are_refused(toml, tmp_path, names, extra, code, value):
    with refused(code, "bed.toml", value):
        read_instrument(toml(two_files(tmp_path, names, extra)))


@pytest.mark.parametrize(
    ("lines", "code", "values"),
    [
        ("indices = [0.1]\ntemperatures = [5000]", ErrorCode.CONFLICT, ["indices"]),
        ("indices = [0.1, 0.2, 0.3]", ErrorCode.WRONG_SHAPE, ["indices"]),
        ("temperatures = [-5]", ErrorCode.OUT_OF_RANGE, [-5.0]),
        ("wavelength_err = -2", ErrorCode.OUT_OF_RANGE, ["wavelength_err", -2]),
        ("index_err = -1", ErrorCode.OUT_OF_RANGE, ["index_err", -1]),
    ],
)
def test_impossible_colours_are_refused_by_file(toml, lines, code, values):
    with refused(code, "bed.toml", *values):
        read_instrument(toml(WHOLE.replace("samples = 5", f"samples = 5\n{lines}")))
