"""Settings: what they change of an instrument and of a fit, and what they refuse."""

from dataclasses import fields, replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import flat_band
from jitterkit.refit import FitOptions
from jitterkit.trade import PRESETS, Settings
from jitterkit.trade.settings import ABERRATIONS, JITTER, METHODS, preset


def test_settings_change_the_instrument_that_is_modelled_and_nothing_else(plain):
    modelled = Settings(pad=12, samples=3, binning=2, region=40).instrument(plain)
    assert modelled.system().grid.pad == 12
    assert modelled.shape == (40, 40)
    assert modelled.spectrum == plain.spectrum.sampled(3)
    assert modelled.pupil.transmission.shape == (128, 128)
    assert modelled.detector is plain.detector
    assert (modelled.plate_scale, modelled.exposure, modelled.flux) == (0.375, 1.0, 1e5)


def test_a_region_is_never_larger_than_the_frame(plain):
    assert Settings(region=100).instrument(plain).shape == plain.shape


def test_held_aberrations_join_what_is_held(plain):
    options = Settings(aberrations="held", tolerance=0.01).options(plain, FitOptions(hold=("contrast",)))
    assert set(options.hold) == {"contrast", "noll7", "noll8"}
    assert options.tolerance == 0.01
    assert not options.may_be_still
    assert Settings(jitter="seen").options(plain).may_be_still
    assert Settings().options(plain).hold == ()


def test_the_balanced_preset_is_what_is_done_without_any(plain):
    """The defaults of the package are a point on the front, and this is it."""
    assert PRESETS["balanced"].options(plain) == FitOptions()
    modelled = PRESETS["balanced"].instrument(plain)
    assert modelled.shape == plain.shape
    others = [field.name for field in fields(plain) if field.name != "shape"]
    assert all(getattr(modelled, name) is getattr(plain, name) for name in others)


def test_nodes_that_were_asked_for_stay_where_none_are_said(plain):
    asked = FitOptions(nodes=8)
    assert Settings().options(plain, asked).nodes == 8
    assert Settings(nodes=12).options(plain, asked).nodes == 12


@pytest.mark.parametrize(
    ("given", "code", "values"),
    [
        ({"aberrations": "guessed"}, ErrorCode.UNKNOWN_NAME, ["'guessed'", *ABERRATIONS]),
        ({"jitter": "never"}, ErrorCode.UNKNOWN_NAME, ["'never'", *JITTER]),
        ({"bits": 16}, ErrorCode.OUT_OF_RANGE, [16, 32, 64]),
        ({"tolerance": 0.0}, ErrorCode.OUT_OF_RANGE, [0]),
        ({"tolerance": float("nan")}, ErrorCode.OUT_OF_RANGE, ["nan"]),
        ({"pad": -1}, ErrorCode.OUT_OF_RANGE, [-1, 0]),
        ({"samples": 0}, ErrorCode.OUT_OF_RANGE, [0, 1]),
        ({"region": 0}, ErrorCode.OUT_OF_RANGE, [0, 1]),
        ({"nodes": 2}, ErrorCode.OUT_OF_RANGE, [2, 3]),
        ({"method": "guess"}, ErrorCode.UNKNOWN_NAME, ["'guess'", *METHODS]),
    ],
)
def test_impossible_settings_are_refused(given, code, values):
    with refused(code, *given, *values):
        Settings(**given)


def test_a_pupil_that_cannot_be_binned_so_is_refused(plain):
    with refused(ErrorCode.OUT_OF_RANGE, 256, 3):
        Settings(binning=3).instrument(plain)


def test_exact_is_never_less_than_the_instrument_asks_for_and_fast_never_more(plain):
    lavish = replace(plain, pad=200, spectrum=flat_band(400.0, 900.0, 40))
    assert preset("exact", lavish).pad == 200
    assert preset("exact", lavish).instrument(lavish).spectrum == lavish.spectrum
    assert preset("exact", plain) == PRESETS["exact"]
    assert preset("fast", replace(plain, pad=4)).pad == 4
    assert preset("fast", plain) == PRESETS["fast"]


def test_a_preset_that_there_is_not_is_refused(plain):
    with refused(ErrorCode.UNKNOWN_NAME, "'slow'", *PRESETS):
        preset("slow", plain)


def test_frames_of_a_scene_lie_on_all_sides_of_the_middle(scene):
    x, y = np.array([[truth.binary.x, truth.binary.y] for truth in scene.truths], float).T
    for offsets in (x, y):
        assert len(set(offsets)) == len(scene.truths)
        assert offsets.min() < 0 < offsets.max()
    assert not np.array_equal(x, y)
