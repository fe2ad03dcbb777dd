"""Curves: straight lines between rows, nothing outside, and sentences for what is none."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import Spectrum, flat_band, lines
from jitterkit.photons import Curve, band_of, flat_curve, read_curve


def test_a_curve_is_straight_between_rows_and_nothing_outside():
    curve = Curve(np.array([500.0, 600.0]), np.array([0.2, 0.6]))
    assert curve(np.array([499.9, 500.0, 525.0, 600.0, 600.1])) == pytest.approx([0, 0.2, 0.3, 0.6, 0])


def test_the_support_reaches_to_the_zero_next_to_the_last_light():
    curve = Curve(np.arange(500.0, 570.0, 10.0), np.array([0, 0, 0.5, 0, 0.5, 0, 0]))
    assert curve.support == (510.0, 550.0)
    assert flat_curve(530, 640).support == (530.0, 640.0)


@pytest.mark.parametrize("samples", [2, 13])
def test_the_filter_of_a_flat_band_has_its_edges(samples):
    assert band_of(flat_band(530, 640, samples)).support == pytest.approx((530, 640), rel=1e-12)


@pytest.mark.parametrize(
    ("spectrum", "values"),
    [
        (lines(550.0), ("1 wavelengths", "550 to 550 nm")),
        (lines(532.0, 560.0, 633.0), ("3 wavelengths", "532 to 633 nm")),
        (Spectrum((530.0, 550.0, 570.0), (1.0, 2.0, 1.0)), ("3 wavelengths", "530 to 570 nm")),
    ],
)
def test_what_is_no_flat_band_has_no_filter(spectrum, values):
    with refused(ErrorCode.UNSUPPORTED, *values):
        band_of(spectrum)


def test_a_curve_is_read_with_names_comments_and_blank_lines(tmp_path):
    path = tmp_path / "filter.csv"
    path.write_text("wavelength,value\n# by the maker\n530,0.9\n\n640,0.8\n")
    curve = read_curve(path)
    np.testing.assert_array_equal(curve.wavelengths, [530, 640])
    np.testing.assert_array_equal(curve.values, [0.9, 0.8])


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("w,v\n530,0.5\n540;0.5\n", ErrorCode.MALFORMED, ("line 3", "'540;0.5'")),
        ("530,1\n", ErrorCode.TOO_FEW, ("1 wavelengths", "1 values")),
        ("540,1\n530,1\n", ErrorCode.MALFORMED, (" 530 ",)),
        ("530,1\nnan,1\n", ErrorCode.MALFORMED, (" nan ",)),
        ("530,1\ninf,1\n", ErrorCode.MALFORMED, (" inf ",)),
        ("-3,1\n530,1\n", ErrorCode.MALFORMED, (" -3 ",)),
        ("530,-1\n540,1\n", ErrorCode.OUT_OF_RANGE, ("-1 to 1",)),
        ("530,0\n540,0\n", ErrorCode.OUT_OF_RANGE, ("0 to 0",)),
    ],
)
def test_a_table_that_is_no_curve_is_refused(tmp_path, text, code, values):
    path = tmp_path / "c.csv"
    path.write_text(text)
    with refused(code, path, *values):
        read_curve(path)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("wavelength_nm,T [%]", "%"),
        ("wavelength_nm,transmission_percent", "percent"),
        ("nm,OD", "OD"),
        ("nm,optical_density", "optical_density"),
        ("nm,absorbance", "absorbance"),
        ("nm,dB", "dB"),
        ("nm,responsivity [A/W]", "responsiv"),
        ("nm,signal_A/W", "A/W"),
        ("nm,reflectance", "reflectance"),
    ],
)
def test_a_column_that_is_no_share_is_refused(names, said, tmp_path):
    path = tmp_path / "c.csv"
    path.write_text(f"{names}\n530,0.5\n640,0.5\n", encoding="utf-8")
    with refused(ErrorCode.UNKNOWN_UNIT, path, f"'{names}' say '{said}'", "0 to 1"):
        read_curve(path)


@pytest.mark.parametrize(
    "name", ["anti-reflection coated T", "transmission_OD4", "1-absorption", "T(%)/100", "T_after_extinction"]
)
def test_a_share_may_say_what_it_is_the_rest_of(name, tmp_path):
    path = tmp_path / "c.csv"
    path.write_text(f"nm,{name}\n530,0.5\n640,0.5\n")
    assert read_curve(path).values.tolist() == [0.5, 0.5]


def test_photons_are_not_taken_for_a_share_nor_power_for_photons(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text("nm,photons % of the peak\n530,40\n640,50\n")
    assert read_curve(path, "photons").values.tolist() == [40, 50]
    path.write_text("nm,flux_erg\n530,0.5\n640,0.5\n")
    with refused(ErrorCode.UNKNOWN_UNIT, path, "'flux'"):
        read_curve(path, "photons")


def test_a_curve_has_as_many_values_as_wavelengths():
    with refused(ErrorCode.WRONG_SHAPE, "3 wavelengths", "2 values"):
        Curve(np.array([530.0, 540.0, 550.0]), np.ones(2))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "none.csv"):
        read_curve(tmp_path / "none.csv")


def test_a_band_out_of_order_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, "640 to 530"):
        flat_curve(640, 530)
