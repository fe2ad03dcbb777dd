import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics import Pupil, obstructed_circle
from jitterkit.optics.pupil_file import read_pupil, write_pupil


def same(one: Pupil, other: Pupil) -> bool:
    arrays = all(np.array_equal(getattr(one, a), getattr(other, a)) for a in ("transmission", "opd", "basis"))
    return arrays and (one.names, one.diameter) == (other.names, other.diameter)


@pytest.fixture
def pupil(rng):
    plain = obstructed_circle(0.3, 0.1, noll=(4, 5, 11), samples=32)
    return Pupil(plain.transmission, 0.3, rng.normal(0, 30, (32, 32)), plain.basis, plain.names)


def write_fits(path, pupil, *, diameter=True, named=True):
    primary = fits.PrimaryHDU()
    if diameter:
        primary.header["DIAMETER"] = pupil.diameter
    if named:
        primary.header.update({f"MODE{k}": name for k, name in enumerate(pupil.names)})
    arrays = {"TRANSMISSION": pupil.transmission, "OPD": pupil.opd, "BASIS": pupil.basis}
    fits.HDUList([primary, *(fits.ImageHDU(a, name=n) for n, a in arrays.items())]).writeto(path)


def test_a_pupil_comes_back_from_npz_bit_for_bit(tmp_path, pupil):
    write_pupil(tmp_path / "p.npz", pupil)
    assert same(read_pupil(tmp_path / "p.npz"), pupil)
    assert [p.name for p in tmp_path.iterdir()] == ["p.npz"]


@pytest.mark.parametrize("name", ["p.fits", "p.fits.gz"])
def test_a_pupil_is_read_from_fits_in_native_byte_order(tmp_path, pupil, name):
    write_fits(tmp_path / name, pupil)
    found = read_pupil(tmp_path / name)
    assert same(found, pupil)
    assert found.basis.dtype.isnative


@pytest.mark.parametrize(("unit", "factor"), [("nm", 1.0), ("micron", 1e-3), ("meters", 1e-9)])
def test_the_wavefront_error_of_a_fits_file_is_in_its_unit(tmp_path, pupil, unit, factor):
    write_fits(tmp_path / "p.fits", pupil)
    with fits.open(tmp_path / "p.fits", mode="update") as file:
        file["OPD"].data *= factor
        file["OPD"].header["BUNIT"] = unit
    assert np.asarray(read_pupil(tmp_path / "p.fits").opd) == pytest.approx(np.asarray(pupil.opd))


def test_a_wavefront_error_in_no_length_is_refused(tmp_path, pupil):
    write_fits(tmp_path / "p.fits", pupil)
    fits.setval(tmp_path / "p.fits", "BUNIT", value="radian", extname="OPD")
    with refused(ErrorCode.UNKNOWN_UNIT, tmp_path / "p.fits", "'radian'"):
        read_pupil(tmp_path / "p.fits")


def test_modes_without_names_in_fits_are_numbered(tmp_path, pupil):
    write_fits(tmp_path / "p.fits", pupil, named=False)
    assert read_pupil(tmp_path / "p.fits").names == ("mode0", "mode1", "mode2")


def test_a_transmission_alone_is_a_pupil_when_the_diameter_is_given(tmp_path, pupil):
    np.savez(tmp_path / "p.npz", transmission=pupil.transmission)
    assert same(read_pupil(tmp_path / "p.npz", diameter=0.3), Pupil(pupil.transmission, 0.3))


def test_a_given_diameter_goes_before_the_files(tmp_path, pupil):
    write_pupil(tmp_path / "p.npz", pupil)
    assert read_pupil(tmp_path / "p.npz", diameter=0.5).diameter == 0.5


def test_a_file_without_diameter_is_refused_unless_it_is_given(tmp_path, pupil):
    write_fits(tmp_path / "p.fits", pupil, diameter=False)
    with refused(ErrorCode.MISSING_VALUE, tmp_path / "p.fits", "diameter"):
        read_pupil(tmp_path / "p.fits")
    assert read_pupil(tmp_path / "p.fits", 0.3).diameter == 0.3


def test_a_missing_file_is_refused(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "none.npz"):
        read_pupil(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("p.npz", b"", ErrorCode.DAMAGED),
        ("p.npz", b"not a pupil at all" * 200, ErrorCode.DAMAGED),
        ("p.fits", b"", ErrorCode.UNKNOWN_FORMAT),
        ("p.fits", b"not a pupil at all" * 200, ErrorCode.UNKNOWN_FORMAT),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path, name, content, code):
    (tmp_path / name).write_bytes(content)
    with refused(code, tmp_path / name, error=ConfigurationError):
        read_pupil(tmp_path / name)


def test_a_truncated_npz_is_refused(tmp_path, pupil):
    write_pupil(tmp_path / "p.npz", pupil)
    whole = (tmp_path / "p.npz").read_bytes()
    (tmp_path / "p.npz").write_bytes(whole[: len(whole) // 2])
    with refused(ErrorCode.DAMAGED, tmp_path / "p.npz"):
        read_pupil(tmp_path / "p.npz")


def test_an_npz_with_pickled_objects_is_refused(tmp_path):
    np.savez(tmp_path / "p.npz", transmission=np.array([object()]), allow_pickle=True)
    with refused(ErrorCode.DAMAGED, tmp_path / "p.npz"):
        read_pupil(tmp_path / "p.npz")


def test_an_npz_without_a_transmission_is_refused_with_what_it_holds(tmp_path):
    np.savez(tmp_path / "p.npz", amplitude=np.ones((4, 4)), diameter=1.0)
    with refused(ErrorCode.MISSING_VALUE, tmp_path / "p.npz", "transmission", ["amplitude", "diameter"]):
        read_pupil(tmp_path / "p.npz")


def test_arrays_that_make_no_pupil_are_refused_with_the_files_name(tmp_path):
    np.savez(tmp_path / "p.npz", transmission=np.ones((4, 5)), diameter=1.0)
    with refused(ErrorCode.WRONG_SHAPE, tmp_path / "p.npz", "transmission", (4, 5)):
        read_pupil(tmp_path / "p.npz")


@pytest.mark.parametrize(
    ("content", "value"),
    [({"diameter": "wide"}, "wide"), ({"diameter": 1.0, "opd": np.full((4, 4), "flat")}, "flat")],
    ids=["diameter", "opd"],
)
def test_words_for_numbers_are_refused_with_the_files_name(tmp_path, content, value):
    np.savez(tmp_path / "p.npz", transmission=np.ones((4, 4)), **content)
    with refused(ErrorCode.WRONG_TYPE, tmp_path / "p.npz", value, error=ConfigurationError):
        read_pupil(tmp_path / "p.npz")


def test_a_complex_field_is_refused(tmp_path):
    """Its phase would be lost."""
    np.savez(tmp_path / "p.npz", transmission=np.ones((4, 4)) * np.exp(0.3j), diameter=1.0)
    with refused(ErrorCode.WRONG_TYPE, tmp_path / "p.npz", "transmission", "complex"):
        read_pupil(tmp_path / "p.npz")


def test_a_wavefront_error_in_metres_is_refused(tmp_path):
    error = np.linspace(-50, 40, 16).reshape(4, 4)
    for opd, is_nm in ((error, True), (error * 1e-9, False), (error * 0, True)):
        np.savez(tmp_path / "p.npz", transmission=np.ones((4, 4)), opd=opd, diameter=1.0)
        if is_nm:
            assert np.array_equal(read_pupil(tmp_path / "p.npz").opd, opd)
            continue
        with refused(ErrorCode.UNKNOWN_UNIT, tmp_path / "p.npz", "5e-08", "nm"):
            read_pupil(tmp_path / "p.npz")


def test_a_pupil_is_written_as_npz_only(tmp_path, pupil):
    with refused(ErrorCode.WRONG_SUFFIX, ".npz", tmp_path / "p.fits"):
        write_pupil(tmp_path / "p.fits", pupil)


def test_a_failed_write_leaves_nothing_behind(tmp_path, pupil, monkeypatch):
    def fail(*args, **kwargs):
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(OSError, match="no space left"):
        write_pupil(tmp_path / "p.npz", pupil)
    assert list(tmp_path.iterdir()) == []
