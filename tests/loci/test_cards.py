"""Header cards of a blur: sizes in mas and arcsec, angles from the axes that other tools count from."""

import pytest

from jitterkit.loci import Mvn, jitter_cards


def test_a_blur_is_given_in_the_units_and_angles_of_each_tool():
    cards = {
        key: value for key, (value, _) in jitter_cards(Mvn.of(0.2, 0.1, 30.0).moments(), normal=True).items()
    }
    assert cards["JITRTYPE"] == "Custom jitter kernel"  # poppy's normal is round
    assert "JITRSIGM" not in cards
    assert cards["JITTER_MAJOR"] == pytest.approx(200.0)  # mas
    assert cards["JITTER_MINOR"] == pytest.approx(100.0)
    assert cards["JITTER_POSITION_ANGLE"] == pytest.approx(60.0)  # from +y towards +x
    assert cards["JTRANGLE"] == pytest.approx(30.0)  # from +x, counter-clockwise


def test_a_round_normal_has_poppys_sigma_in_arcsec():
    cards = jitter_cards(Mvn.of(0.2, 0.199).moments(), normal=True)
    assert cards["JITRTYPE"][0] == "Gaussian convolution"
    assert cards["JITRSIGM"][0] == pytest.approx(0.2, rel=0.01)
    assert "JITRSIGM" not in jitter_cards(Mvn.of(0.2, 0.2).moments())  # round, but no normal
