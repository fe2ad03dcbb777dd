"""Where the image plane lies on the sky."""

import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS, Sip

from jitterkit.frames import resolve_header, sky_position_angle
from jitterkit.frames.fitsio import PlainHeader
from jitterkit.frames.sky import plate_scale, turned_over
from jitterkit.frames.wcs import celestial_wcs

SCALE = 0.375


def tangent(rotation=0.0, east=-1.0, dec=-60.0, up=1.0):
    """North at +y turned by ``rotation`` counter-clockwise; east to the left for east = -1."""
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.crval, wcs.wcs.crpix = [219.9, dec], [64.5, 64.5]
    c, s = np.cos(np.radians(rotation)), np.sin(np.radians(rotation))
    # world = diag(east, 1) R(-rotation) pixel
    wcs.wcs.cd = np.diag([east, up]) @ np.array([[c, s], [-s, c]]) * SCALE / 3600
    wcs.wcs.set()
    return wcs


def apart(angle, other):
    """Difference of two angles in [-180, 180)."""
    return (angle - other + 180) % 360 - 180


@pytest.mark.parametrize(("theta", "pa"), [(90, 0), (180, 90), (270, 180), (0, 270), (135, 45)])
def test_with_north_up_and_east_left_the_angle_runs_from_plus_y_to_minus_x(theta, pa):
    assert abs(apart(sky_position_angle(tangent(), 63.5, 63.5, theta), pa)) < 1e-6


@pytest.mark.parametrize(("theta", "pa"), [(90, 0), (0, 90), (270, 180), (180, 270)])
def test_with_east_right_the_angle_runs_the_other_way(theta, pa):
    assert abs(apart(sky_position_angle(tangent(east=1.0), 63.5, 63.5, theta), pa)) < 1e-6


def test_a_turned_camera_turns_the_angle_back():
    turned = tangent(rotation=17.0)
    assert abs(apart(sky_position_angle(turned, 63.5, 63.5, 90 + 17.0), 0)) < 1e-6
    assert abs(apart(sky_position_angle(turned, 63.5, 63.5, 90 + 17.0 + 30), 30)) < 1e-6


def test_the_angle_agrees_with_astropys_great_circles_near_the_pole():
    wcs = tangent(rotation=33.0, dec=89.999)
    here, there = (
        wcs.pixel_to_world(20.0, 100.0),
        wcs.pixel_to_world(20.0 + 1e-3 * np.cos(1), 100.0 + 1e-3 * np.sin(1)),
    )
    expected = here.position_angle(there).deg
    assert sky_position_angle(wcs, 20.0, 100.0, np.degrees(1)) == pytest.approx(expected, abs=1e-3)


def test_the_scale_is_the_root_of_the_pixels_area():
    scale, warnings = plate_scale(tangent(rotation=17.0))
    assert scale == pytest.approx(SCALE, rel=1e-12)
    assert warnings == []


def test_pixels_that_are_not_square_are_a_warning():
    scale, (warning,) = plate_scale(tangent(up=1.21))
    assert scale == pytest.approx(SCALE * 1.1, rel=1e-12)
    assert "0.375 x 0.45375 arcsec" in warning
    assert "0.4125 arcsec" in warning


def test_the_wcs_beats_pixscale_and_a_disagreement_is_a_warning():
    metadata = resolve_header(fits.Header({"PIXSCALE": 0.5}), wcs=tangent())
    assert metadata.plate_scale.value == pytest.approx(SCALE)
    assert "WCS" in metadata.plate_scale.source
    assert "header PIXSCALE (HDU 0) = 0.5" in metadata.warnings[0]
    assert "0.375 arcsec/pixel" in metadata.warnings[0]


def icrs_angle(wcs, x, y, theta):
    """Position angle by astropy's coordinates, of a step of a hundredth of a pixel."""
    here, there = (
        wcs.pixel_to_world(x + s * np.cos(np.radians(theta)), y + s * np.sin(np.radians(theta))).icrs
        for s in (0.0, 0.01)
    )
    return here.position_angle(there).deg


@pytest.mark.parametrize(
    ("ctype", "radesys", "equinox"),
    [
        (("RA---TAN", "DEC--TAN"), "FK5", 2000.0),
        (("RA---TAN", "DEC--TAN"), "FK5", 1975.0),
        (("RA---TAN", "DEC--TAN"), "FK4", 1950.0),
        (("RA---TAN", "DEC--TAN"), "FK4-NO-E", 1950.0),
        (("GLON-TAN", "GLAT-TAN"), "", None),
        (("ELON-TAN", "ELAT-TAN"), "", None),
    ],
)
def test_the_position_angle_is_from_the_north_of_icrs_in_every_frame(ctype, radesys, equinox):
    wcs = tangent(rotation=33.0)
    wcs.wcs.ctype, wcs.wcs.radesys = list(ctype), radesys
    if equinox is not None:
        wcs.wcs.equinox = equinox
    if ctype[0].startswith("ELON"):  # which astropy's own pixel_to_world does not know
        lon, lat = wcs.pixel_to_world_values(
            [20.0, 20.0 + 0.01 * np.cos(1)], [100.0, 100.0 + 0.01 * np.sin(1)]
        )
        here, there = SkyCoord(lon, lat, unit="deg", frame="barycentricmeanecliptic").icrs
        expected = here.position_angle(there).deg
    else:
        expected = icrs_angle(wcs, 20.0, 100.0, np.degrees(1))
    got = sky_position_angle(wcs, 20.0, 100.0, np.degrees(1))
    assert abs(apart(got, expected)) < 1e-3  # 1e-7 degrees of the two steps in half a pixel of 1e-4


@pytest.mark.parametrize("key", ["RADESYS", "RADECSYS"])
@pytest.mark.parametrize(
    ("name", "equinox"), [("fk5", 1975.0), ("Fk4", 1950.0), ("fk4-no-e", 1950.0), ("icrs ", 2000.0)]
)
def test_the_frame_of_coordinates_may_be_in_lower_case(key, name, equinox):
    given, upper = (tangent(rotation=33.0).to_header() for _ in range(2))
    for cards, text in ((given, name), (upper, name.upper())):
        cards.remove("RADESYS", ignore_missing=True)
        cards.update({key: text, "EQUINOX": equinox})
    (made, warnings), (expected, _) = celestial_wcs(plain(given)), celestial_wcs(plain(upper))
    assert warnings == []
    angle = sky_position_angle(expected, 20.0, 100.0, 57.0)
    assert sky_position_angle(made, 20.0, 100.0, 57.0) == pytest.approx(angle, abs=1e-9)


def test_axes_in_the_other_order_give_the_same_angle():
    wcs = tangent(rotation=33.0)
    other = WCS(naxis=2)
    other.wcs.ctype, other.wcs.crval = list(wcs.wcs.ctype)[::-1], wcs.wcs.crval[::-1]
    other.wcs.crpix, other.wcs.cd = wcs.wcs.crpix, wcs.wcs.cd[::-1]
    made, warnings = celestial_wcs(plain(other.to_header()))
    assert warnings == []
    assert sky_position_angle(made, 20.0, 100.0, 57.0) == pytest.approx(
        sky_position_angle(wcs, 20.0, 100.0, 57.0), abs=1e-6
    )
    assert plate_scale(made)[0] == pytest.approx(SCALE, rel=1e-9)


@pytest.mark.parametrize(
    "ctype", [("TLON-TAN", "TLAT-TAN"), ("HPLN-TAN", "HPLT-TAN"), ("RA---TAN", "DEC--TAN")]
)
def test_coordinates_that_are_not_of_the_stars_give_no_angle(ctype):
    wcs = tangent()
    wcs.wcs.ctype = list(ctype)
    wcs.wcs.radesys = "GAPPT" if ctype[0].startswith("RA") else ""
    assert np.isnan(sky_position_angle(wcs, 20.0, 100.0, 57.0))


def test_a_sky_that_does_not_lie_along_the_axes_of_the_image_is_not_used():
    cards = {"CTYPE1": "RA---TAN", "CTYPE2": "FREQ", "CTYPE3": "DEC--TAN"}
    wcs, warnings = celestial_wcs(plain(fits.Header({**cards, "CDELT1": -1e-4, "CDELT3": 1e-4, "NAXIS": 3})))
    assert wcs is None
    assert "axes" in warnings[0]


def test_a_default_scale_of_one_degree_is_none():
    cards = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CDELT1": 1.0, "CDELT2": 1.0}
    wcs, warnings = celestial_wcs(plain(fits.Header(cards)))
    assert wcs is None
    assert "1 degree" in warnings[0]


@pytest.mark.parametrize("keep", ["cd", "pc", "sip"])
def test_turned_rows_keep_their_places_on_the_sky(keep):
    wcs = tangent(rotation=33.0)
    if keep == "pc":
        wcs = WCS(wcs.to_header())
        assert wcs.wcs.has_pc()
    if keep == "sip":
        a, b = np.zeros((3, 3)), np.zeros((3, 3))
        a[2, 0], a[0, 1], a[1, 1], b[0, 2], b[1, 0] = 1e-5, 2e-3, 3e-5, -2e-5, 1e-3
        wcs.sip = Sip(a, b, None, None, wcs.wcs.crpix)
    turned = turned_over(wcs, 128)
    y = np.array([0.0, 20.0, 127.0])
    np.testing.assert_allclose(
        turned.pixel_to_world_values(30.0, 127.0 - y), wcs.pixel_to_world_values(30.0, y), atol=1e-10
    )
    assert plate_scale(turned)[0] == pytest.approx(plate_scale(wcs)[0], rel=1e-12)


def plain(header):
    return PlainHeader(header.tostring(endcard=False, padding=False).encode())


def test_a_header_makes_the_wcs_it_describes():
    wcs, warnings = celestial_wcs(plain(tangent().to_header()))
    assert plate_scale(wcs)[0] == pytest.approx(SCALE, rel=1e-9)
    assert warnings == []


def test_axes_without_a_projection_are_a_tangent_plane_with_a_warning():
    named, plain_axes = (tangent(rotation=33.0, dec=60.0).to_header() for _ in range(2))
    plain_axes["CTYPE1"], plain_axes["CTYPE2"] = "RA", "DEC"
    (expected, _), (wcs, warnings) = celestial_wcs(plain(named)), celestial_wcs(plain(plain_axes))
    angles = [sky_position_angle(one, 20.0, 30.0, 25.0) for one in (wcs, expected)]
    assert angles[0] == pytest.approx(angles[1], abs=1e-9)
    assert "no projection" in warnings[0]


def test_headers_without_celestial_axes_make_none():
    assert celestial_wcs(plain(fits.Header({"EXPTIME": 1}))) == (None, [])
    assert (
        celestial_wcs(plain(fits.Header({"CTYPE1": "LINEAR", "CTYPE2": "LINEAR", "CDELT1": 1.0})))[0] is None
    )


def test_a_wcs_without_a_scale_is_not_believed():
    wcs, warnings = celestial_wcs(plain(fits.Header({"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN"})))
    assert wcs is None
    assert "CD, PC or CDELT" in warnings[0]


@pytest.mark.parametrize(("number", "has_scale"), [(0.0, False), (1e-4, True), (1e200, True)])
def test_a_wcs_that_cannot_be_inverted_is_not_believed(number, has_scale):
    cards = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN"}
    cards |= dict.fromkeys(("CD1_1", "CD1_2", "CD2_1", "CD2_2"), number)
    wcs, warnings = celestial_wcs(plain(fits.Header(cards)))
    assert wcs is None
    assert len(warnings) == 1
    assert "WCS" in warnings[0]
    assert ("CD, PC or CDELT" not in warnings[0]) == has_scale


def test_the_sides_compared_are_the_pixels_and_not_the_skys():
    wcs = tangent(rotation=45.0)
    wcs.wcs.cd = wcs.wcs.cd @ np.diag([1.0, 1.21])
    assert "0.375 x 0.45375 arcsec" in plate_scale(wcs)[1][0]


def test_a_wcs_of_an_absurd_scale_gives_none():
    metadata = resolve_header(fits.Header({"PIXSCALE": 0.5}), wcs=tangent(up=1e40))
    assert metadata.plate_scale.source == "header PIXSCALE (HDU 0)"
    assert any("3.75e+19" in text and "0 to 100000 arcsec/pixel" in text for text in metadata.warnings)
