"""What a run says about the shutter of its detector."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from jitterkit.cli.run import warn_of_rolling_shutter
from jitterkit.instruments import load_instrument


def run_of(locus, error=1e-4):
    """A run of 20 frames of a pair 10 arcsec apart, with a jitter of 0.1 arcsec rms."""
    separation = {"n": 20, "mean": 10.0, "error": error}
    return SimpleNamespace(
        summary={"separation": separation, "locus": {locus: 20}, "jitter": {"major": 0.1, "minor": 0.0}}
    )


@pytest.mark.parametrize(
    ("preset", "locus", "error", "said"),
    [
        # 0.1 sqrt(12) arcsec in 0.1 s, over the 15 us of 10 / 0.375 rows: 1.4 mas
        ("toliman", "linear", 1e-4, ["3.46", "1.4 mas", "1.5e-05"]),
        ("toliman", "linear", 2e-3, []),
        ("toliman", "mvn", 1e-4, []),
        ("jwst", "linear", 1e-4, []),
        ("toliman-camera", "mvn", 1e-4, ["400 \u00b5as per arcsec/s", "jitterkit sequence"]),
    ],
)
def test_a_drift_that_rows_exposed_in_turn_would_make_a_bias_is_warned_of(preset, locus, error, said, capsys):
    warn_of_rolling_shutter(run_of(locus, error), load_instrument(preset))
    text = " ".join(capsys.readouterr().err.split())
    assert bool(text) == bool(said)
    for words in said:
        assert words in text


def test_a_shutter_that_is_said_to_be_global_is_believed(capsys):
    telescope = load_instrument("toliman")
    telescope = replace(telescope, detector=replace(telescope.detector, line_time=0.0))
    warn_of_rolling_shutter(run_of("linear"), telescope)
    assert not capsys.readouterr().err
