"""A run is resumed as it was begun, or the first difference is named."""

import math

import pytest
from refusals import refused

from jitterkit.batch.configuration import settings
from jitterkit.batch.resume import refuse_difference
from jitterkit.batch.store import Store
from jitterkit.errors import ErrorCode

CONFIGURATION = {
    "--locus": "auto",
    "priors": [1.0, math.nan],
    "files": ["a.fits", "b.fits"],
    "versions": {"jax": "0.10"},
}


def test_the_same_configuration_may_be_said_in_another_way(tmp_path):
    other = dict(reversed(CONFIGURATION.items())) | {"priors": (1, float("nan"))}
    refuse_difference(tmp_path, CONFIGURATION, CONFIGURATION | {"priors": [1, float("nan")]})
    with Store.create(tmp_path, CONFIGURATION):
        pass
    with Store.resume(tmp_path, other) as again:
        assert again.configuration["files"] == CONFIGURATION["files"]


def test_what_is_not_made_of_a_new_setting_is_no_difference(tmp_path):
    old = CONFIGURATION | {"options": {"tolerance": 1e-4}}
    new = CONFIGURATION | {"options": {"tolerance": 1e-4, "nodes": None, "if_free": {}}}
    refuse_difference(tmp_path, old, new)
    refuse_difference(tmp_path, new, old)


@pytest.mark.parametrize(
    ("changes", "values"),
    [
        ({"--locus": "mvn"}, ["--locus auto", "mvn"]),
        ({"priors": [1.0, 2.0]}, ["priors[1]", "NaN", "2.0"]),
        ({"priors": [1.0]}, ["priors[1]", "NaN"]),
        (
            {"files": ["a.fits", "\x1b[2J", "b.fits"]},
            [" 1 ", r"(\x1b[2J)", "--overwrite", "--resume", "'jitterkit watch'"],
        ),
        ({"files": ["0", "a.fits", "1", "2", "b.fits"]}, [" 3 ", "(0 ", "--overwrite"]),
        ({"files": ["b.fits"]}, [" 1 ", "(a.fits)"]),
        ({"files": []}, [" 2 ", "(a.fits "]),
        ({"files": ["x" * 200, "b.fits"]}, ["files[0]", "a.fits", f" {'x' * 77}..."]),
        ({"files": ["b.fits", "a.fits"]}, ["files[0]", "a.fits", "b.fits"]),
        ({"--rays": True}, ["--rays true"]),
        ({"versions": {"jax": "0.11"}}, ["versions.jax", "0.10", "0.11"]),
        ({"versions": {}}, ["versions.jax", "0.10"]),
    ],
    ids=["value", "nan", "shorter", "come", "more", "went", "all", "long", "order", "new", "version", "gone"],
)
def test_another_configuration_is_refused_by_its_first_difference(tmp_path, changes, values):
    with Store.create(tmp_path, CONFIGURATION) as ledger:
        ledger.add(0, [{"frame": 1}])
    with refused(ErrorCode.CONFLICT, tmp_path, *values):
        Store.resume(tmp_path, CONFIGURATION | changes)
    with Store.resume(tmp_path, CONFIGURATION) as again:  # which the refusal left alone
        assert again.done() == {0}


def test_other_options_of_xla_are_another_configuration(tmp_path, processor, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_one=1")
    begun = settings(processor, [])
    refuse_difference(tmp_path, begun, settings(processor, []))
    monkeypatch.setenv("XLA_FLAGS", "")
    with refused(ErrorCode.CONFLICT, tmp_path, "XLA_FLAGS", "--xla_one=1"):
        refuse_difference(tmp_path, begun, settings(processor, []))
