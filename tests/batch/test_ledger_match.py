"""A run is resumed as it was begun, or the first difference is named."""

import math

import pytest

from jitterkit.batch.ledger import Ledger
from jitterkit.batch.ledger_match import refuse_difference
from jitterkit.errors import ConfigurationError

CONFIGURATION = {
    "--locus": "auto",
    "priors": [1.0, math.nan],
    "files": ["a.fits", "b.fits"],
    "versions": {"jax": "0.10"},
}


def test_the_same_configuration_may_be_said_in_another_way(tmp_path):
    other = dict(reversed(CONFIGURATION.items())) | {"priors": (1, float("nan"))}
    refuse_difference(tmp_path, CONFIGURATION, CONFIGURATION | {"priors": [1, float("nan")]})
    with Ledger.create(tmp_path, CONFIGURATION):
        pass
    with Ledger.resume(tmp_path, other) as again:
        assert again.configuration["files"] == CONFIGURATION["files"]


def test_what_is_not_made_of_a_new_setting_is_no_difference(tmp_path):
    old = CONFIGURATION | {"options": {"tolerance": 1e-4}}
    new = CONFIGURATION | {"options": {"tolerance": 1e-4, "nodes": None, "if_free": {}}}
    refuse_difference(tmp_path, old, new)
    refuse_difference(tmp_path, new, old)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"--locus": "mvn"}, r"was begun with --locus auto, not mvn; give the same, or another directory\."),
        ({"priors": [1.0, 2.0]}, r"with priors\[1\] NaN, not 2\.0; give"),
        ({"priors": [1.0]}, r"with priors\[1\] NaN, not without; give"),
        (
            {"files": ["a.fits", "\x1b[2J", "b.fits"]},
            r"was begun without 1 of these files \(\\x1b\[2J\); process .* another directory, give "
            "--overwrite instead of --resume .* or let 'jitterkit watch' follow",
        ),
        (
            {"files": ["0", "a.fits", "1", "2", "b.fits"]},
            r"without 3 of these files \(0 for one\); process what",
        ),
        (
            {"files": ["b.fits"]},
            r"was begun with 1 file more than these \(a\.fits\); put back what is missing",
        ),
        ({"files": []}, r"was begun with 2 files more than these \(a\.fits for one\); put back"),
        ({"files": ["x" * 200, "b.fits"]}, r"files\[0\] a\.fits, not x{77}\.\.\.;"),
        ({"files": ["b.fits", "a.fits"]}, r"files\[0\] a\.fits, not b\.fits;"),
        ({"--rays": True}, "was begun without --rays, not with --rays true;"),
        (
            {"versions": {"jax": "0.11"}},
            r"with versions\.jax 0\.10, not 0\.11, .* the same versions; install",
        ),
        ({"versions": {}}, r"with versions\.jax 0\.10, not without, and .* the same versions"),
    ],
    ids=["value", "nan", "shorter", "come", "more", "went", "all", "long", "order", "new", "version", "gone"],
)
def test_another_configuration_is_refused_by_its_first_difference(tmp_path, changes, sentence):
    with Ledger.create(tmp_path, CONFIGURATION) as ledger:
        ledger.add(0, [{"frame": 1}])
    with pytest.raises(ConfigurationError, match=sentence):
        Ledger.resume(tmp_path, CONFIGURATION | changes)
    with Ledger.resume(tmp_path, CONFIGURATION) as again:  # which the refusal left alone
        assert again.done() == {0}
