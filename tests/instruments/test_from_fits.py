"""PSFs and pupils in the formats of poppy and stpsf, written by hand, against brute force."""

import subprocess
import sys

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused
from scipy.special import j1

from jitterkit.errors import ErrorCode
from jitterkit.forward import Parameters, expected_image, image_and_jacobian
from jitterkit.instruments import instrument_from_fits, load_instrument
from jitterkit.loci import Mvn, Stable
from jitterkit.scene import Star

ARCSEC = np.pi / 648000
WIDTH, N, WAVE = 2.4, 192, 0.6e-6
SCALE, K, FOV = 0.04, 4, 48
"""Pixel [arcsec] of a detector that undersamples, samples per pixel of the PSF, its width in pixels."""


def _aperture():
    """A lopsided pupil with coma, tilt and defocus: no symmetry hides a sign or an exchanged axis."""
    x, y = np.meshgrid(*[(np.arange(N) - (N - 1) / 2) / (N / 2)] * 2)
    clear = (np.hypot(x, y) < 1) & (np.hypot(x, y) > 0.33) & ~((np.abs(y) < 0.05) & (x > 0))
    opd = 40 * (3 * np.hypot(x, y) ** 2 - 2) * x + 15 * y + 25 * (2 * np.hypot(x, y) ** 2 - 1)
    return clear.astype(float), opd


def _psf(pitch, samples):
    """Light at points in poppy's convention: a wavefront error [nm] growing with +x moves it towards -x."""
    amplitude, opd = _aperture()
    x = (np.arange(N) - (N - 1) / 2) * WIDTH / N
    t = (np.arange(samples) - (samples - 1) / 2) * pitch * ARCSEC
    kernel = np.exp(2j * np.pi / WAVE * np.outer(t, x))
    field = kernel @ (amplitude * np.exp(2j * np.pi * opd * 1e-9 / WAVE)) @ kernel.T
    return np.abs(field) ** 2 * (WIDTH / N * pitch * ARCSEC / WAVE) ** 2 / (amplitude**2).sum()


def _cards(pitch, **more):
    return {
        "PIXELSCL": pitch, "WAVELEN": WAVE, "DIFFLMT": WAVE / WIDTH / ARCSEC, "OVERSAMP": K, "DET_SAMP": K,
        "NORMALIZ": "first", "PIXUNIT": "arcsecond", **more,
    }  # fmt: skip


@pytest.fixture
def write(tmp_path):
    """Write images with EXTNAMEs and cards, the first as the primary HDU."""

    def written(name, *images):
        units = [(fits.ImageHDU if k else fits.PrimaryHDU)(data) for k, (data, _) in enumerate(images)]
        for unit, (_, cards) in zip(units, images, strict=True):
            unit.header.update(cards)
        fits.HDUList(units).writeto(tmp_path / name)
        return tmp_path / name

    return written


def _both(scale):
    """The images OVERSAMP and DET_SAMP of a detector, as poppy's Instrument writes them."""
    width = round(FOV * SCALE / scale)
    points = _psf(scale / K, width * K)
    sums = points.reshape(width, K, width, K).sum(axis=(1, 3))
    first = (points, _cards(scale / K, EXTNAME="OVERSAMP"))
    return first, (sums, _cards(scale, EXTNAME="DET_SAMP", OVERSAMP=1, CALCSAMP=K))


def _image(path, x=0.011, y=-0.023):
    otf = load_instrument(path).optics()
    return np.asarray(expected_image(Parameters(Star(x=x, y=y, flux=1.0), Stable.of()), otf))


def _pupil_toml(tmp_path, write, scale):
    amplitude, opd = _aperture()
    pupil = write("pupil.fits", (amplitude, {"PUPLSCAL": WIDTH / N, "CONTENTS": "amplitude"}))
    error = write("opd.fits", (opd * 1e-3, {"PUPLSCAL": WIDTH / N, "CONTENTS": "opd", "BUNIT": "microns"}))
    path = tmp_path / "pupil.toml"
    instrument_from_fits(pupil, path, opd=error, wavelength=WAVE * 1e9, plate_scale=scale, shape=(24, 20))
    return path


@pytest.mark.parametrize(
    ("scale", "hdu", "oversample"), [(0.04, 0, 2), (0.04, None, 2), (0.02, 0, 1), (0.02, 1, 1)]
)
def test_pupil_and_psf_of_one_telescope_give_one_image(tmp_path, write, scale, hdu, oversample):
    psf, path = write("psf.fits", *_both(scale)), tmp_path / "psf.toml"
    instrument_from_fits(psf, path, hdu=hdu, shape=(24, 20))
    assert load_instrument(path).psf_options["oversample"] == oversample
    wanted = _image(_pupil_toml(tmp_path, write, scale))
    # what is beyond the stamp, about a percent of the light, is missed at its edge alone
    assert _image(path) == pytest.approx(wanted, abs=3e-6 * wanted.max())


def _airy_star(x, y, covariance, pixels):
    """Airy's law, averaged over pixels by Gauss-Legendre and over a normal jitter by Gauss-Hermite rules."""
    inside, weights = np.polynomial.legendre.leggauss(6)
    steps, shares = np.polynomial.hermite_e.hermegauss(7)
    root = np.linalg.cholesky(covariance)
    centres = (np.arange(pixels) - (pixels - 1) / 2) * SCALE
    image = np.zeros((pixels, pixels))
    for i, a in enumerate(inside):
        for j, b in enumerate(inside):
            for m, u in enumerate(steps):
                for n, v in enumerate(steps):
                    dx, dy = root @ (u, v)
                    column, row = np.meshgrid(
                        centres + a * SCALE / 2 - x - dx, centres + b * SCALE / 2 - y - dy
                    )
                    share = weights[i] * weights[j] / 4 * shares[m] * shares[n] / (2 * np.pi)
                    image += share * _airy(np.hypot(column, row))
    return image * SCALE**2


def _airy(radius):
    """Share of the light per arcsec² at a radius [arcsec]."""
    v = np.maximum(np.pi * WIDTH * radius * ARCSEC / WAVE, 1e-9)
    return np.pi / 4 * (WIDTH * ARCSEC / WAVE) ** 2 * (2 * j1(v) / v) ** 2


@pytest.mark.parametrize("name", ["OVERSAMP", "DET_SAMP"])
def test_a_star_of_airys_law_is_unbiased_in_place_and_jitter(tmp_path, write, name):
    """One step of least squares from the truth, on an image by brute force."""
    samples = K * 200
    t = (np.arange(samples) - (samples - 1) / 2) * SCALE / K
    points = _airy(np.hypot(*np.meshgrid(t, t))) * (SCALE / K) ** 2
    images = {"OVERSAMP": (points, _cards(SCALE / K, EXTNAME="OVERSAMP"))}
    sums = points.reshape(samples // 2, 2, samples // 2, 2).sum(axis=(1, 3))
    images["DET_SAMP"] = (sums, _cards(SCALE / 2, EXTNAME="DET_SAMP", OVERSAMP=1, CALCSAMP=2))
    path = tmp_path / "airy.toml"
    scale = {"OVERSAMP": 1.0, "DET_SAMP": 0.5}[name]  # a detector with half the pixels samples the optics
    instrument_from_fits(write("psf.fits", images[name]), path, shape=(24, 24))
    covariance = np.array([[4e-4, 1.5e-4], [1.5e-4, 2e-4]])
    otf = load_instrument(path).optics()
    assert otf.grid.plate_scale == pytest.approx(SCALE * scale)
    locus = Mvn(np.array([covariance[0, 0], covariance[0, 1], covariance[1, 1]]))
    truth = Parameters(Star(x=0.013, y=-0.006, flux=1.0), locus)
    model, jacobian = (np.asarray(a) for a in image_and_jacobian(truth, otf, tuple(range(7))))
    assert otf.grid.shape == (24, 24)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "SCALE", SCALE * scale)
        image = _airy_star(0.013, -0.006, covariance, 24)
    weights = 1 / np.sqrt(np.maximum(image, 1e-6))
    bias, *_ = np.linalg.lstsq(
        (jacobian * weights).reshape(7, -1).T, ((image - model) * weights).ravel(), rcond=None
    )
    named = dict(zip(("x", "y", "flux", "xx", "xy", "yy", "background"), bias, strict=True))
    # the stamp ends 100 pixels from the star and lacks 0.4 % of the light, spread over what is left
    assert abs(named["x"]) < 1e-6
    assert abs(named["y"]) < 1e-6
    for size in ("xx", "xy", "yy"):
        assert abs(named[size]) < 1e-7  # half a thousandth of 2e-4; a sum of 4 points misses 1e-5


def test_a_psf_by_fft_is_centred_on_sample_n_2(tmp_path, write):
    clear = np.zeros((512, 512))
    clear[:N, :N] = np.hypot(*np.meshgrid(*[np.arange(N) - (N - 1) / 2] * 2)) < N / 2
    light = np.abs(np.fft.fftshift(np.fft.fft2(clear))) ** 2
    pitch = WAVE / (WIDTH / N * 512) / ARCSEC
    psf = write("psf.fits", (light / light.sum(), _cards(pitch, DET_SAMP=1, OVERSAMP=2)))
    instrument_from_fits(psf, tmp_path / "a.toml", plate_scale=2 * pitch)
    instrument = load_instrument(tmp_path / "a.toml")
    assert np.array(instrument.psf_options["centre"]) * 2 / instrument.psf_options["oversample"] == (
        pytest.approx([256.0, 256.0])
    )


@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-9), ("nanometers", 1.0), ("micron", 1e-3)])
def test_wavefront_errors_come_in_any_unit_of_length_and_change_their_sign(tmp_path, write, unit, factor):
    amplitude, opd = _aperture()
    file = write(
        "p.fits",
        (amplitude**2, {"PIXELSCL": WIDTH / N, "PIXUNIT": "meter", "CONTENTS": "intensity"}),
        (np.where(amplitude > 0, opd, np.nan) * factor, {"EXTNAME": "OPD", "BUNIT": unit}),
    )
    instrument_from_fits(
        file, tmp_path / "p.toml", band=(500, 600), plate_scale=0.03, shape=(8, 8), noll=(7, 8)
    )
    pupil = load_instrument(tmp_path / "p.toml").pupil
    assert pupil.opd == pytest.approx(np.where(amplitude > 0, -opd, 0.0))
    assert pupil.transmission == pytest.approx(amplitude)
    assert (pupil.diameter, pupil.names) == (pytest.approx(WIDTH), ("noll7", "noll8"))
    # unit rms over the unit disc, whose edge lies at that of the pupil
    assert np.mean(np.asarray(pupil.basis)[0][amplitude > 0] ** 2) == pytest.approx(1.0, abs=0.2)


def test_a_pupil_in_a_wider_array_keeps_its_own_scale(tmp_path, write):
    amplitude = np.pad(_aperture()[0], 16)
    told = {"PIXSCALE": WIDTH / N, "PUPLDIAM": WIDTH, "PUPLSCAL": WIDTH / N}
    instrument_from_fits(
        write("p.fits", (amplitude, told)),
        tmp_path / "p.toml",
        wavelength=600,
        plate_scale=0.03,
        shape=(8, 8),
    )
    assert load_instrument(tmp_path / "p.toml").pupil.diameter == pytest.approx(WIDTH * 224 / 192)


STAR = np.pad(np.outer(np.hanning(16), np.hanning(16)), 24)
DISC = (np.hypot(*np.meshgrid(np.arange(32) - 15.5, np.arange(32) - 15.5)) < 15.5).astype(float)
SAMPLED = {"PIXELSCL": 0.01, "DET_SAMP": 4, "OVERSAMP": 4, "EXTNAME": "OVERSAMP"}
LENGTHS = {"PUPLSCAL": 0.075}
LIGHT = {"wavelength": 600.0, "plate_scale": 0.03, "shape": (8, 8)}


@pytest.mark.parametrize(
    ("image", "cards", "options", "code", "values"),
    [
        (STAR, {**SAMPLED, "JITRTYPE": "Gaussian convolution", "JITRSIGM": 0.007}, {}, ErrorCode.CONFLICT,
         ("0.007 arcsec", "--jittered")),
        (STAR, {"PIXELSCL": 0.01, "DET_SAMP": 2, "FFTTYPE": "numpy"}, {}, ErrorCode.MISSING_VALUE,
         ("0.01 arcsec", "--plate-scale")),
        (STAR, {**SAMPLED, "PIXELSCL": 0}, {}, ErrorCode.MISSING_VALUE, ("PIXELSCL = 0",)),
        (STAR, {**SAMPLED, "PIXELSCL": 1e-5}, {}, ErrorCode.MISSING_VALUE, ("1e-05", "PIXUNIT")),
        (STAR, {**SAMPLED, "PIXUNIT": "meters"}, {"kind": "psf"}, ErrorCode.MISSING_VALUE, ("'meters'",)),
        (STAR, SAMPLED, {"plate_scale": 0.025}, ErrorCode.OUT_OF_RANGE, ("2.5 samples", "--plate-scale")),
        (STAR, {**SAMPLED, "EXTNAME": "DET_SAMP"}, {"plate_scale": 0.02}, ErrorCode.CONFLICT,
         ("0.01 arcsec", "0.02")),
        (STAR, SAMPLED, {"hdu": 3}, ErrorCode.NO_IMAGE, ("HDU 3", "0 OVERSAMP")),
        (STAR, SAMPLED, {"diameter": 2.0}, ErrorCode.CONFLICT, ("diameter = 2.0", "psf")),
        (np.where(STAR > 0.9, np.nan, STAR), SAMPLED, {}, ErrorCode.OUT_OF_RANGE, ("HDU 0",)),
        (np.stack([STAR, STAR]), SAMPLED, {}, ErrorCode.WRONG_SHAPE, ("(2, 64, 64)",)),
        (np.pad([[1.0]], 15), SAMPLED, {}, ErrorCode.SAMPLING, ("HDU 0", "--hdu")),
        (np.round(200 * STAR), SAMPLED, {}, ErrorCode.SAMPLING, (" steps", "16 bits")),
        (STAR + 0.1, SAMPLED, {}, ErrorCode.OUT_OF_RANGE, ("0.1", "background")),
        (STAR, {}, {}, ErrorCode.MISSING_VALUE, ("--kind",)),
        (STAR, SAMPLED, {"kind": "pdf"}, ErrorCode.UNKNOWN_NAME, ("pdf",)),
        (DISC, LENGTHS, {"plate_scale": 0.03}, ErrorCode.MISSING_VALUE, ("--band", "--wavelength")),
        (DISC, LENGTHS, {"wavelength": 600.0}, ErrorCode.MISSING_VALUE, ("--plate-scale",)),
        (DISC, LENGTHS, {**LIGHT, "band": (500, 600)}, ErrorCode.CONFLICT, ("--band", "--wavelength")),
        (DISC, LENGTHS, {**LIGHT, "hdu": 1}, ErrorCode.CONFLICT, ("hdu = 1", "pupil")),
        (DISC, {**LENGTHS, "WAVELEN": 600.0}, {"plate_scale": 0.03, "kind": "pupil"}, ErrorCode.OUT_OF_RANGE,
         ("6e+11 nm", "--wavelength")),
        (DISC[4:], LENGTHS, LIGHT, ErrorCode.MISSING_VALUE, ("(28, 32)",)),
        (DISC, {"PIXELSCL": (0.075, "[arcsec/pixel]")}, {**LIGHT, "kind": "pupil"}, ErrorCode.MISSING_VALUE,
         ("metres", "--diameter")),
        (DISC, LENGTHS, {**LIGHT, "opd_unit": "nm"}, ErrorCode.CONFLICT, ("--opd-unit nm",)),
        (DISC, LENGTHS, {**LIGHT, "plane": 0}, ErrorCode.CONFLICT, ("--plane 0",)),
        (DISC, {"CONTENTS": "amplitude"}, LIGHT, ErrorCode.MISSING_VALUE, ("PUPLSCAL", "--diameter")),
        (DISC, {**LENGTHS, "PUPLDIAM": 3.1}, LIGHT, ErrorCode.CONFLICT, ("0.075 m", "3.1 m", "--diameter")),
        (DISC, {**LENGTHS, "CONTENTS": "opd"}, LIGHT, ErrorCode.MISSING_VALUE, ("transmission", "--opd")),
        (-DISC, LENGTHS, LIGHT, ErrorCode.OUT_OF_RANGE, ("-1",)),
        (DISC, LENGTHS, {**LIGHT, "noll": (1,)}, ErrorCode.OUT_OF_RANGE, ("--noll 1", "from 2")),
        (DISC, LENGTHS, {**LIGHT, "noll": (4, 4)}, ErrorCode.DUPLICATE, ("--noll 4",)),
        (DISC, LENGTHS, {**LIGHT, "opd_unit": "nm"}, ErrorCode.CONFLICT, ("--opd-unit nm", "--opd")),
        (DISC, LENGTHS, {**LIGHT, "plane": 0}, ErrorCode.CONFLICT, ("--plane 0", "--opd")),
        (DISC, LENGTHS, {**LIGHT, "shape": (400, 400)}, ErrorCode.SAMPLING, ("[telescope] samples",)),
    ],
)  # fmt: skip
def test_what_a_file_does_not_tell_is_asked_for_by_name(tmp_path, write, image, cards, options, code, values):
    path = write("a.fits", (image, cards))
    with refused(code, *values):
        instrument_from_fits(path, tmp_path / "a.toml", **options)
    assert [p.name for p in tmp_path.iterdir()] == ["a.fits"]


@pytest.mark.parametrize(
    ("opd", "cards", "options", "code", "values"),
    [
        (DISC, {"EXTNAME": "OPD"}, {}, ErrorCode.MISSING_VALUE, ("HDU 1", "--opd-unit")),
        (DISC, {"EXTNAME": "OPD", "BUNIT": "radian"}, {}, ErrorCode.UNKNOWN_UNIT, ("'radian'",)),
        (DISC, {"EXTNAME": "OPD", "BUNIT": "m", "PUPLSCAL": 0.15}, {}, ErrorCode.CONFLICT,
         ("0.15 m", "0.075 m")),
        (DISC[1:, 1:], {"EXTNAME": "OPD", "BUNIT": "m"}, {}, ErrorCode.WRONG_SHAPE, ("(31, 31)", "(32, 32)")),
        (np.stack([DISC, DISC]), {"EXTNAME": "OPD", "BUNIT": "m"}, {}, ErrorCode.MISSING_VALUE,
         ("2 wavefront", "--plane")),
        (DISC, {"EXTNAME": "OPD", "BUNIT": "m"}, {"plane": 0}, ErrorCode.CONFLICT, ("--plane 0",)),
        (DISC * np.nan, {"EXTNAME": "OPD", "BUNIT": "m"}, {}, ErrorCode.OUT_OF_RANGE, ("NaN",)),
    ],
)  # fmt: skip
def test_a_wavefront_error_must_suit_its_pupil(tmp_path, write, opd, cards, options, code, values):
    path = write("a.fits", (DISC, LENGTHS), (opd, cards))
    with refused(code, *values):
        instrument_from_fits(path, tmp_path / "a.toml", **LIGHT, **options)


def test_a_shaking_psf_is_taken_if_it_is_allowed(tmp_path, write):
    path = write("a.fits", (STAR, {**SAMPLED, "JITRTYPE": "Gaussian convolution"}))
    instrument_from_fits(path, tmp_path / "a.toml", jittered=True)
    assert load_instrument(tmp_path / "a.toml").shape == (8, 8)


def test_help_loads_no_jax():
    code = (
        "import sys\nfrom jitterkit.cli.main import app\n"
        "try: app(['instrument', '--help'])\nexcept SystemExit: pass\n"
        "sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode == 0


@pytest.mark.parametrize(
    "cards",
    [
        {"PIXELSCL": (10.0, "[mas/pixel]")},
        {"PIXELSCL": (10.0, "scale"), "PIXUNIT": "mas"},
        {"PIXELSCL": (0.01 / 3600, "deg per pixel")},
        {"PIXELSCL": (0.01 * ARCSEC * 1e6, "in urad")},
        {"PIXELSCL": (0.01, "Scale in arcsec/pix (after oversampling)"), "PIXUNIT": "arcsecond"},
    ],
)
def test_the_samples_of_a_psf_are_in_the_unit_that_the_file_states(tmp_path, write, cards):
    instrument_from_fits(write("a.fits", (STAR, SAMPLED | cards)), tmp_path / "a.toml")
    assert load_instrument(tmp_path / "a.toml").plate_scale == pytest.approx(0.04, rel=1e-6)


@pytest.mark.parametrize(
    "cards",
    [
        {"PUPLSCAL": (75.0, "mm per pixel")},
        {"PIXELSCL": (7.5, "scale"), "PIXUNIT": "cm"},
        {"DIAMETER": (2400.0, "[mm]")},
        {"PUPLSCAL": (0.075, "pupil scale in m / pixel for 32 pixels")},
        {"PUPLSCAL": 0.075, "PUPLDIAM": (2.4, "Pupil *FILE* diameter in m (incl padding)")},
    ],
)
def test_the_samples_of_a_pupil_are_in_the_unit_that_the_file_states(tmp_path, write, cards):
    path, light = write("a.fits", (DISC, cards)), LIGHT | {"wavelength": None, "plate_scale": 0.01}
    with fits.open(path, mode="update") as hdus:
        hdus[0].header["WAVELEN"] = (0.6, "microns")
    instrument_from_fits(path, tmp_path / "a.toml", kind="pupil", **light)
    instrument = load_instrument(tmp_path / "a.toml")
    assert instrument.pupil.diameter == pytest.approx(2.4)
    assert instrument.spectrum.wavelengths == pytest.approx([600.0])


def test_a_psf_whose_rows_run_from_the_top_is_turned_over(tmp_path, write):
    psf = STAR * np.linspace(0.5, 1.5, len(STAR))[:, None]
    for name, image, cards in (("up", psf, {}), ("down", psf[::-1], {"ROWORDER": "TOP-DOWN"})):
        instrument_from_fits(write(f"{name}.fits", (image, SAMPLED | cards)), tmp_path / f"{name}.toml")
    up, down = (fits.getdata(tmp_path / f"{name}-psf.fits") for name in ("up", "down"))
    np.testing.assert_allclose(down, up, atol=1e-15)
