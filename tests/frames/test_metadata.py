"""What is known about a frame, and who is believed."""

import itertools

import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import Metadata, Sourced
from jitterkit.frames.units import resolve_unit

LAYERS = {
    "command line": 1.0,
    "sidecar a.toml": 2.0,
    "instrument file s.toml": 3.0,
    "header X": 4.0,
    "preset p": 5.0,
}


def test_layers_may_be_laid_in_any_order_and_the_most_authoritative_wins():
    for order in itertools.permutations(LAYERS):
        metadata = Metadata()
        for source in order:
            metadata = metadata.apply(source, gain=LAYERS[source])
        assert metadata.gain == Sourced(1.0, "e-/ADU", "command line")


def test_of_equal_sources_the_later_is_believed():
    metadata = Metadata().apply("preset a", gain=1).apply("preset b", gain=2)
    assert metadata.gain.value == 2


def test_override_replaces_and_fill_does_not():
    metadata = Metadata().override("header X", gain=2, exposure=3)
    assert metadata.override("preset", gain=5).gain.value == 5
    filled = metadata.fill("preset", gain=5, bias=100)
    assert (filled.gain.value, filled.bias.value, filled.exposure.value) == (2, 100, 3)


def test_none_says_nothing():
    metadata = Metadata().override("header X", gain=2)
    assert metadata.override("command line", gain=None) == metadata


@pytest.mark.parametrize(
    ("name", "value", "code", "told"),
    [
        ("gain", 0, ErrorCode.OUT_OF_RANGE, ["gain = 0", "e-/ADU"]),
        ("gain", -1, ErrorCode.OUT_OF_RANGE, ["gain = -1", "0 to 100000 e-/ADU"]),
        ("exposure", "long", ErrorCode.WRONG_TYPE, ["exposure = 'long'", "in s"]),
        ("exposure", [1.0, 2.0], ErrorCode.WRONG_TYPE, ["exposure = [1.0, 2.0]", "in s"]),
        ("read_noise", float("nan"), ErrorCode.OUT_OF_RANGE, ["read_noise = nan", "e-"]),
        ("plate_scale", True, ErrorCode.WRONG_TYPE, ["plate_scale = True", "arcsec/pixel"]),
        ("unit", "Jy", ErrorCode.UNKNOWN_UNIT, ["unit = 'Jy'", "'adu'", "'electron'"]),
        ("colour", 1, ErrorCode.UNKNOWN_NAME, ["'colour'", "exposure, gain"]),
    ],
)
def test_a_value_nobody_can_mean_is_refused(name, value, code, told):
    with refused(code, *told, error=ConfigurationError):
        Metadata().override("command line", **{name: value})


@pytest.mark.parametrize(
    ("text", "unit"),
    [("e-", "electron"), ("Electrons", "electron"), ("counts", "adu"), ("ADU", "adu"), ("DN", "adu"),
     ("", "adu"), (" [ADU] ", "adu"), ("photo electrons", "electron"), ("Jy/beam", None), ("ADU/s", "adu/s"),
     ("e-/pixel/s", "electron/s"), ("electrons s-1", "electron/s"), ("count.s**-1", "adu/s"),
     ("DN per second", "adu/s"), ("cps", "adu/s"), ("electron/min", None)],
)  # fmt: skip
def test_units_are_read_leniently(text, unit):
    assert resolve_unit(text) == unit


def test_rows_say_everything_known_and_unknown():
    rows = Metadata().override("command line", gain=3.7, time="2026-11-21").rows()
    assert ("gain", "3.7", "e-/ADU", "command line") in rows
    assert ("time", "2026-11-21", "UTC", "command line") in rows
    assert ("bias", "unknown", "ADU", "") in rows
    assert ("wcs", "unknown", "", "") in rows


def test_a_warning_is_kept_once():
    assert Metadata().warn("a", "b").warn("a").warnings == ("a", "b")


def test_a_long_warning_keeps_its_beginning_and_its_end():
    (said,) = Metadata().warn(f"EXPTIME = {'ten' * 1000!r} is not a number and is ignored").warnings
    assert said.startswith("EXPTIME = 'tenten")
    assert said.endswith("ten' is not a number and is ignored")
    assert len(said) < 350


def test_bare_values_have_defaults():
    assert Metadata().value("gain", 1.0) == 1.0
    assert Metadata().override("preset", gain=2).value("gain", 1.0) == 2.0


def test_turning_the_rows_over_turns_the_time_between_them():
    said = Metadata().override("header X", line_time=1e-5)
    assert said.row_order == 1
    turned = said.reordered(-1)
    assert (turned.row_order, turned.value("line_time"), turned.line_time.source) == (-1, -1e-5, "header X")
    assert Metadata().reordered(-1).line_time is None
    assert Metadata().override("header X", line_time=0.0).reordered(0).warnings == ()
