"""Where the image plane lies on the sky."""

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS

from jitterkit.frames import resolve_header, sky_position_angle
from jitterkit.frames.plainheader import PlainHeader
from jitterkit.frames.sky import plate_scale
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
    scale, warning = plate_scale(tangent(rotation=17.0))
    assert scale == pytest.approx(SCALE, rel=1e-12)
    assert warning is None


def test_pixels_that_are_not_square_are_a_warning():
    scale, warning = plate_scale(tangent(up=1.21))
    assert scale == pytest.approx(SCALE * 1.1, rel=1e-12)
    assert "0.375 x 0.45375 arcsec" in warning
    assert "0.4125 arcsec" in warning


def test_the_wcs_beats_pixscale_and_a_disagreement_is_a_warning():
    metadata = resolve_header(fits.Header({"PIXSCALE": 0.5}), wcs=tangent())
    assert metadata.plate_scale.value == pytest.approx(SCALE)
    assert "WCS" in metadata.plate_scale.source
    assert "header PIXSCALE (HDU 0) = 0.5" in metadata.warnings[0]
    assert "0.375 arcsec/pixel" in metadata.warnings[0]


def plain(header):
    return PlainHeader(header.tostring(endcard=False, padding=False).encode(), fits.Card.fromstring)


def test_a_header_makes_the_wcs_it_describes():
    wcs, warnings = celestial_wcs(plain(tangent().to_header()))
    assert plate_scale(wcs)[0] == pytest.approx(SCALE, rel=1e-9)
    assert warnings == []


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
    assert "0.375 x 0.45375 arcsec" in plate_scale(wcs)[1]


def test_a_wcs_of_an_absurd_scale_gives_none():
    metadata = resolve_header(fits.Header({"PIXSCALE": 0.5}), wcs=tangent(up=1e40))
    assert metadata.plate_scale.source == "header PIXSCALE (HDU 0)"
    assert any("3.75e+19" in text and "0 to 100000 arcsec/pixel" in text for text in metadata.warnings)
