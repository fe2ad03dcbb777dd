import pytest

from jitterkit.errors import printable
from jitterkit.report.words import angle_size, ellipse_size, number, with_error

NAN = float("nan")


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (8.0999863, 4.9e-5, "8.099986 ± 0.000049"),
        (8.1, 9.96e-5, "8.10000 ± 0.00010"),
        (-0.8, 0.02, "−0.800 ± 0.020"),
        (37.0, 2.0, "37.0 ± 2.0"),
        (412.0, 125.0, "410 ± 120"),
        (3.811e7, 7000.0, "(3.81100 ± 0.00070) × 10⁷"),
        (2e-7, 3e-6, "(0.2 ± 3.0) × 10⁻⁶"),
        (1.5, NAN, "1.50000"),
        (1.5, float("inf"), "1.50000"),
        (NAN, 0.1, "–"),
    ],
)
def test_a_value_ends_at_the_second_digit_of_its_error(value, error, text):
    assert with_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(999.96, 4, "1000"), (0.0, 3, "0"), (-0.25, 2, "−0.25"), (123456.0, 2, "120000"), (NAN, 3, "–")],
)
def test_numbers_are_written_without_computer_exponents(value, digits, text):
    assert number(value, digits) == text


def test_a_small_angle_gets_the_unit_that_suits_it():
    assert [angle_size(a) for a in (2.408e-4, 9.999e-4, 0.05, 8.1, NAN)] == [
        "241 µas", "1.00 mas", "50.0 mas", "8.10″", "–",
    ]  # fmt: skip


def test_both_axes_of_an_ellipse_share_the_unit_of_the_larger():
    assert ellipse_size(0.2, 0.09) == "200 × 90 mas"
    assert ellipse_size(0.2, 2e-9) == "200 × 0 mas"
    assert ellipse_size(NAN, NAN) == "–"


def test_nothing_unprintable_survives():
    undecodable = b"n\xff.fits".decode("utf-8", "surrogateescape")
    assert printable(undecodable) == r"n\udcff.fits"
    assert printable("\x1b[31mred\u202e\n") == r"\x1b[31mred\u202e\n"
    assert printable("α Cen, Nacht 1 <b>") == "α Cen, Nacht 1 <b>"
