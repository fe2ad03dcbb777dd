"""The TOLIMAN preset and its cache."""

import importlib.metadata
import logging
import sys

import jax
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import pupil_from_dlux, toliman_pupil
from jitterkit.optics.toliman import cache_directory


@pytest.fixture(scope="module")
def toliman_system():
    return pytest.importorskip("dLuxToliman").TolimanOpticalSystem(
        noll_indices=list(range(4, 23)), oversample=1
    )


@pytest.fixture(scope="module")
def toliman(toliman_system):
    return pupil_from_dlux(toliman_system, [f"noll{j}" for j in range(4, 23)])


@pytest.fixture
def directory(tmp_path, monkeypatch):
    monkeypatch.setenv("JITTERKIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def builds(monkeypatch, toliman_system):
    """Records every construction of dLux's system (some seconds) and hands out the one there is."""
    import dLuxToliman

    calls = []

    def build(**options):
        calls.append(options | {"x64": jax.config.jax_enable_x64})
        return toliman_system

    monkeypatch.setattr(dLuxToliman, "TolimanOpticalSystem", build)
    return calls


def same(one, other):
    exact = all(np.array_equal(getattr(one, a), getattr(other, a)) for a in ("transmission", "opd"))
    return exact and np.allclose(one.basis, other.basis, rtol=0, atol=1e-12)


def test_the_pupil_is_dlux_tolimans(toliman, toliman_system):
    assert toliman.diameter == 0.125
    assert toliman.transmission.shape == (256, 256)
    amplitude = np.asarray(toliman_system.aperture.transmission)
    assert toliman.transmission == pytest.approx(amplitude / amplitude.max(), abs=1e-15)
    lit = amplitude > 0
    assert toliman.opd[lit] == pytest.approx(1e9 * np.asarray(toliman_system.pupil.opd)[lit], abs=1e-11)
    assert np.array_equal(toliman.basis, toliman_system.aperture.basis)


def test_noll_s_polynomials_are_those_that_dlux_toliman_would_compute(directory, toliman):
    ours = toliman_pupil()
    assert ours.names == toliman.names
    assert ours.basis == pytest.approx(toliman.basis, abs=1e-12)
    assert ours.transmission == pytest.approx(toliman.transmission, abs=1e-15)
    assert ours.opd[toliman.transmission > 0] == pytest.approx(
        toliman.opd[toliman.transmission > 0], abs=1e-11
    )
    assert float(ours.light) == float(toliman.light)


def test_the_pupil_is_built_once_and_read_back_bit_for_bit(directory, builds, toliman):
    first, second = toliman_pupil(), toliman_pupil()
    assert builds == [{"x64": True}]
    assert same(first, toliman)
    assert same(second, toliman)
    assert np.array_equal(first.basis, second.basis)
    assert second.names == toliman.names == tuple(f"noll{j}" for j in range(4, 23))


def test_the_paper_has_the_first_seven_aberrations(directory, builds, toliman):
    few = toliman_pupil(10)
    assert few.names == ("noll4", "noll5", "noll6", "noll7", "noll8", "noll9", "noll10")
    assert few.basis == pytest.approx(toliman.basis[:7], abs=1e-12)
    assert np.array_equal(few.opd, toliman.opd)


def test_the_pupil_is_built_in_double_precision_whatever_the_caller_works_in(directory, builds, toliman):
    with jax.enable_x64(False):
        assert same(toliman_pupil(), toliman)
        assert not jax.config.jax_enable_x64
    assert builds[0]["x64"] is True


@pytest.mark.parametrize("content", [b"", b"PK damaged"], ids=["empty", "damaged"])
def test_a_damaged_file_is_rewritten(directory, builds, toliman, content):
    toliman_pupil()
    (file,) = directory.iterdir()
    file.write_bytes(content)
    assert same(toliman_pupil(), toliman)
    assert len(builds) == 2
    assert same(toliman_pupil(), toliman)
    assert len(builds) == 2


def test_a_directory_that_cannot_be_written_to_is_only_remarked(directory, builds, toliman, caplog):
    directory.write_text("a file where the directory should be")
    with caplog.at_level(logging.INFO, logger="jitterkit"):
        assert same(toliman_pupil(), toliman)
    (remark,) = caplog.records
    assert remark.levelno == logging.INFO
    assert isinstance(remark.args[0], OSError)
    assert str(directory) in remark.getMessage()


def test_another_release_of_dlux_toliman_has_its_own_file(directory, builds, monkeypatch):
    toliman_pupil()
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "9.9.9")
    toliman_pupil()
    assert len(builds) == 2
    assert len(list(directory.iterdir())) == 2
    assert any("9.9.9" in file.name for file in directory.iterdir())


def absent(name):
    raise importlib.metadata.PackageNotFoundError(name)


def test_without_dlux_toliman_the_kept_pupil_serves(directory, builds, toliman, monkeypatch):
    toliman_pupil()
    (file,) = directory.iterdir()
    file.rename(directory / "toliman-pupil-0.5.1-noll22.npz")
    monkeypatch.setattr(importlib.metadata, "version", absent)
    monkeypatch.setitem(sys.modules, "dLuxToliman", None)
    assert same(toliman_pupil(), toliman)
    assert len(builds) == 1


def test_without_dlux_toliman_and_without_a_kept_pupil_the_extra_is_named(directory, monkeypatch):
    monkeypatch.setattr(importlib.metadata, "version", absent)
    monkeypatch.setitem(sys.modules, "dLuxToliman", None)
    with refused(ErrorCode.MISSING_PACKAGE, "dLuxToliman", "jitterkit[toliman]"):
        toliman_pupil()


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {"JITTERKIT_CACHE": "/a", "XDG_CACHE_HOME": "/b"}, "/a"),
        ("linux", {"XDG_CACHE_HOME": "/b"}, "/b/jitterkit"),
        ("linux", {}, "~/.cache/jitterkit"),
        ("darwin", {"XDG_CACHE_HOME": "/b"}, "~/Library/Caches/jitterkit"),
        ("win32", {"LOCALAPPDATA": "/c"}, "/c/jitterkit"),
        ("win32", {}, "~/AppData/Local/jitterkit"),
    ],
)
def test_the_cache_lies_where_the_platform_keeps_caches(monkeypatch, tmp_path, platform, variables, expected):
    for name in ("JITTERKIT_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    assert cache_directory().as_posix() == expected.replace("~", tmp_path.as_posix())
