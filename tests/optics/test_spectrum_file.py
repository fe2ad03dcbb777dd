"""Spectra from tables: a few wavelengths worth as much as all of them."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import flat_band
from jitterkit.optics.spectrum_file import band_from_table, read_spectrum


@pytest.mark.parametrize("samples", [1, 5, 13])
def test_a_flat_table_is_a_flat_band(samples):
    table, band = (
        band_from_table(np.array([530.0, 560.0, 640.0]), np.ones(3), samples),
        flat_band(530, 640, samples),
    )
    assert table.wavelengths == pytest.approx(band.wavelengths, rel=1e-12)
    assert table.weights == pytest.approx(band.weights, rel=1e-10)


def test_the_moments_of_a_crooked_spectrum_are_exact_to_twice_the_samples():
    # density 2u on 0 < u < 1, u = (wavelength - 500 nm)/100 nm: the integral of 2 u u^k is 2/(k + 2)
    spectrum = band_from_table(np.array([500.0, 600.0]), np.array([0.0, 2.0]), 4)
    u = (np.array(spectrum.wavelengths) - 500) / 100
    for k in range(8):
        assert np.sum(np.array(spectrum.weights) * u**k) == pytest.approx(2 / (k + 2), rel=1e-12)


def test_a_spectrum_with_a_hole_has_no_light_in_it_that_weighs():
    at = np.array([500.0, 510.0, 510.1, 589.9, 590.0, 600.0])
    spectrum = band_from_table(at, np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0]), 2)
    assert spectrum.wavelengths == pytest.approx((505.0, 595.0), abs=1.0)


def test_a_csv_with_names_comments_and_blank_lines_is_read(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("wavelength_nm, photons\n# lamp\n530, 1\n\n640, 1\n")
    assert read_spectrum(path, 3).wavelengths == pytest.approx(flat_band(530, 640, 3).wavelengths)


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("w,p\n530,1\n540;2\n", ErrorCode.MALFORMED, ("line 3", "540;2")),
        ("530,1\n", ErrorCode.TOO_FEW, ("1 rows", "13 samples")),
        ("", ErrorCode.TOO_FEW, ("0 rows", "13 samples")),
        ("540,1\n530,1\n", ErrorCode.MALFORMED, (" 530 ",)),
        ("530,1\n530,1\n", ErrorCode.MALFORMED, (" 530 ",)),
        ("-5,1\n530,1\n", ErrorCode.MALFORMED, (" -5 ",)),
        ("530,1\n540,-2\n", ErrorCode.OUT_OF_RANGE, ("-2 to 1",)),
        ("530,0\n540,0\n", ErrorCode.OUT_OF_RANGE, ("0 to 0",)),
        ("530,1\n540,nan\n", ErrorCode.OUT_OF_RANGE, ("nan to nan",)),
        ("530,1\n540,\xff\n", ErrorCode.MALFORMED, ("0xff",)),
    ],
)
def test_a_table_that_is_no_spectrum_is_refused(tmp_path, text, code, values):
    path = tmp_path / "s.csv"
    path.write_text(text, encoding="latin-1")
    with refused(code, path, *values):
        read_spectrum(path)


def test_a_spectrum_is_not_modelled_with_no_wavelengths():
    with refused(ErrorCode.OUT_OF_RANGE, "2 rows", "0 samples"):
        band_from_table(np.array([530.0, 640.0]), np.ones(2), 0)


def test_a_file_that_cannot_be_read_is_distinguished_from_one_that_is_not_there(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "none.csv"):
        read_spectrum(tmp_path / "none.csv")
    with refused(ErrorCode.NOT_READABLE, tmp_path):
        read_spectrum(tmp_path)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        *(
            ("wavelength [A],photons", "A"),
            ("wavelength_angstrom,photons", "angstrom"),
            ("w (µm),photons", "µm"),
        ),
        *(
            ("nu_THz,photons", "THz"),
            ("lambda (m),photons", "m"),
            ("wavenumber,photons", "wavenumber"),
        ),
        *(("wavelength_nm,signal_erg", "erg"), ("nm,W/m2/nm", "W/"), ("wavelength_nm,F_lambda", "F_lambda")),
        ("wavelength_nm,AB_mag", "mag"),
        ("wavelength_nm,flux", "flux"),
        ("wavelength_nm,signal_W", "W"),
        ("wavelength_nm,irradiance", "irradiance"),
        ("wavelength_nm,spectral radiance", "radiance"),
        ("wavelength_nm,power", "power"),
    ],
)
def test_names_that_say_other_units_are_refused(names, said, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"{names}\n5300,1\n6400,1\n", encoding="utf-8")
    with refused(ErrorCode.UNKNOWN_UNIT, path, f"'{names}'") as caught:
        read_spectrum(path)
    assert f"say '{said.strip('/')}'" in str(caught.value)


@pytest.mark.parametrize(
    "names",
    [
        *("wavelength_nm,photons", "Wavelength (nm),QE", "wave,counts", "lambda,transmission"),
        *("wave,of image", "nm,photon_flux", "nm,flux [ph/s]", "nm,photon irradiance"),
    ],
)
def test_names_that_say_nothing_else_are_read(names, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"{names}\n530,1\n640,1\n", encoding="utf-8")
    assert read_spectrum(path, 3).wavelengths == pytest.approx(flat_band(530, 640, 3).wavelengths)


def test_a_comment_that_names_the_columns_is_believed(tmp_path):
    """As numpy.savetxt writes it, whose header is a comment."""
    path = tmp_path / "a.csv"
    table = np.array([[5300.0, 1.0], [6400.0, 1.0]])
    for names, said in (("wavelength_A,photons", "A"), ("wavelength (nm),flux (erg/s/cm2/nm)", "flux")):
        np.savetxt(path, table, delimiter=",", header=names)
        with refused(ErrorCode.UNKNOWN_UNIT, path, f"'{names}'", f"'{said}'"):
            read_spectrum(path)
    table[:, 0] /= 10
    for text in ("wavelength_nm,photons", "a lamp, at full power", "lamp A\nday 3"):
        np.savetxt(path, table, delimiter=",", header=text)
        assert read_spectrum(path, 3).wavelengths == pytest.approx(flat_band(530, 640, 3).wavelengths)


@pytest.mark.parametrize("names", ["", "# a lamp\nwavelength_nm,photons\n"])
def test_a_byte_order_mark_costs_no_row_and_a_comment_no_names(names, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"{names}530,1\n560,1\n640,1\n", encoding="utf-8-sig")
    assert read_spectrum(path, 3).wavelengths == pytest.approx(flat_band(530, 640, 3).wavelengths)
