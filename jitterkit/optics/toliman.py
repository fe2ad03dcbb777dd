"""TOLIMAN's optics: the diffractive pupil of dLuxToliman's default optical system.

dLuxToliman takes three seconds to build it, so the arrays are kept on disk and the second start is
immediate, with or without that package.  Its aberrations are Noll's polynomials, which are written here: it
takes four seconds more for them, and they are the same to rounding.

:func:`pupil_from_dlux` makes a :class:`~jitterkit.optics.pupil.Pupil` of any dLux optical system.  A
wavefront of 0.1 mm wavelength is sent through the system's layers: so long that no phase wraps, so that
its amplitude and phase *are* the transmission and the path difference, whatever the layers are called.
Sent through again in visible light, with every coefficient moved, the system must agree with the pupil;
one that does not is refused.

Only attributes of the system are used, and dLux itself is never imported here.
"""

from __future__ import annotations

import importlib.metadata
import logging
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jitterkit.conventions import offsets
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.pupil import Pupil, zernike
from jitterkit.optics.pupil_file import read_pupil, write_pupil

_LONG = 1e-4  # m; rounding of the phase is then 2e-12 nm, and 50 um of path still do not wrap
_VISIBLE = (4.7e-7, 8.3e-7)  # m
_NUDGE = 1e-8  # m of each coefficient: 0.1 rad in the visible
_TOLERANCE = 1e-6  # of the largest amplitude: above single precision, below any chromatic layer


def pupil_from_dlux(system: Any, names: Sequence[str] | None = None) -> Pupil:
    """Take the pupil out of a dLux optical system.

    Parameters
    ----------
    system : dLux LayeredOpticalSystem, AngularOpticalSystem or CartesianOpticalSystem
        Its layers may transmit, delay and carry an aberration basis; coefficients are in m, as in
        dLux.  Its focal-plane settings are ignored: the grid of the frame takes their place.
    names : sequence of str, optional
        Of the aberration modes, in the order of the layers; ``mode0``, ``mode1``... by default.

    Returns
    -------
    pupil : Pupil
        The system as it stands.  Coefficients it already carries are part of the static ``opd``, and
        aberrations count from there, in nm.

    Raises
    ------
    ConfigurationError
        If there are no layers, or they do anything else than transmit and delay: a phase that does
        not scale with wavelength, a propagation, an aberration basis applied as phase.

    Notes
    -----
    Assumes nothing about the sampling: dLux and jitterkit both centre the pupil on the axis.  Only
    bases held as arrays become free aberrations; those of dLux's dynamic apertures are frozen.
    """
    if not (getattr(system, "layers", None) and hasattr(system, "initialise_wavefront")):
        problem = f"Expected a dLux optical system made of layers, got {type(system).__name__}"
        remedy = "pass an AngularOpticalSystem or a LayeredOpticalSystem"
        raise ConfigurationError(ErrorCode.WRONG_TYPE, f"{problem}; {remedy}.")
    with jax.enable_x64(True):
        field = _field(system, _LONG)
        opd = np.angle(field) * _LONG / (2 * np.pi) * 1e9
        modes = _modes(system)
        basis = np.concatenate([np.zeros((0, *field.shape)), *modes.values()])
        pupil = Pupil(np.abs(field) / np.abs(field).max(), float(system.diameter), opd, basis, names)
        _verify(system, pupil, modes)
    return pupil


def _field(system, wavelength):
    """Return the complex amplitude after the last layer."""
    wavefront = system.initialise_wavefront(wavelength)
    samples, pitch = wavefront.npixels, float(wavefront.pixel_scale)
    for name, layer in system.layers.items():
        wavefront = layer(wavefront)
        if wavefront.npixels != samples or not np.isclose(float(wavefront.pixel_scale), pitch):
            problem = f"The dLux layer {name!r} changes the wavefront's sampling"
            remedy = "only systems whose layers all lie in one pupil can be used"
            raise ConfigurationError(ErrorCode.UNSUPPORTED, f"{problem}; {remedy}.")
    return np.asarray(wavefront.phasor)


def _modes(system) -> dict[str, np.ndarray]:
    """Aberration bases (k, n, n) by layer."""
    bases: dict[str, Any] = {name: getattr(layer, "basis", None) for name, layer in system.layers.items()}
    return {
        name: np.asarray(basis, float).reshape(-1, *np.shape(basis)[-2:])
        for name, basis in bases.items()
        if len(np.shape(basis)) >= 3 and hasattr(system.layers[name], "coefficients")
    }


def _verify(system, pupil, modes) -> None:
    """Compare with the system itself in the visible, with every aberration moved."""
    moved = eqx.tree_at(
        lambda s: [s.layers[name].coefficients for name in modes],
        system,
        [system.layers[name].coefficients + _NUDGE for name in modes],
    )
    opd = pupil.opd + _NUDGE * 1e9 * pupil.basis.sum(axis=0)
    for wavelength in _VISIBLE:
        expected = pupil.transmission * np.exp(2j * np.pi / (wavelength * 1e9) * opd)
        field = _field(moved, wavelength)
        difference = np.abs(field / np.abs(field).max() - expected).max()
        if not difference < _TOLERANCE:
            raise ConfigurationError(
                ErrorCode.UNSUPPORTED,
                f"The dLux system is more than transmission, path difference and aberrations: at "
                f"{wavelength * 1e9:.0f} nm its wavefront differs from such a pupil's by {difference:.2g} of "
                "the largest amplitude; remove layers whose phase does not scale with wavelength.",
            )


_HIGHEST = 22
"""Of Noll's aberrations that a frame shows: 2 nm of those from 11 to 22 bias a separation by up to 355 uas if
they are not fitted, and fitting them costs nothing in its error.  The paper has those up to 10."""

_OVERSIZE = 1.01
"""Diameter of the disc over which its aberrations have unit rms, in diameters of the mirror."""

_REFERENCE = "0.5.1"  # the release that jitterkit is tested against, to rounding
_log = logging.getLogger(__name__)


def toliman_pupil(highest: int = _HIGHEST) -> Pupil:
    """Return TOLIMAN's pupil on 256 x 256 samples, with Noll's aberrations from 4 on.

    Parameters
    ----------
    highest : int
        Last of the aberrations, 4 to 22.

    Returns
    -------
    pupil : Pupil
        0.125 m wide, 0.032 m obscured, three struts; steps of half a wavelength at 585 nm.  Equal to
        rounding to ``dLuxToliman.TolimanOpticalSystem(noll_indices=range(4, highest + 1))``.

    Raises
    ------
    ConfigurationError
        If the pupil is not on disk and dLuxToliman is not installed.

    Notes
    -----
    Kept in the directory that the environment variable ``JITTERKIT_CACHE`` names, or in the user's
    cache directory; a damaged file is written again, and a directory that cannot be written to costs
    three seconds at each start.
    """
    try:
        version = importlib.metadata.version("dLuxToliman")
    except importlib.metadata.PackageNotFoundError:
        version = _REFERENCE
    path = cache_directory() / f"toliman-pupil-{version}-noll{_HIGHEST}.npz"
    pupil = None
    if path.exists():
        try:
            pupil = read_pupil(path)
        except ConfigurationError as problem:
            _log.info("Building the TOLIMAN pupil again: %s", problem)
    if pupil is None:
        pupil = _build()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_pupil(path, pupil)
        except OSError as problem:
            _log.info("The TOLIMAN pupil cannot be kept for the next start: %s", problem)
    return replace(pupil, basis=pupil.basis[: highest - 3], names=pupil.names[: highest - 3])


def cache_directory() -> Path:
    """Return the directory in which jitterkit caches results."""
    chosen = os.environ.get("JITTERKIT_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        root = Path.home() / "Library" / "Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "jitterkit"


def _build() -> Pupil:
    try:
        from dLuxToliman import TolimanOpticalSystem
    except ImportError:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE,
            "The TOLIMAN pupil comes from dLuxToliman, which is not installed; "
            'run: pip install "jitterkit[toliman]"',
        ) from None
    with jax.enable_x64(True):  # the same pupil whatever precision the caller works in
        system = TolimanOpticalSystem()  # without its polynomials, which take most of the time
    pupil, indices = pupil_from_dlux(system), range(4, _HIGHEST + 1)
    samples = len(pupil.opd)
    x, y = np.meshgrid(*[offsets(samples, 2 / samples / _OVERSIZE)] * 2)
    inside = np.hypot(x, y) <= 1
    basis = np.array([zernike(j, x, y) * inside for j in indices])
    names = [f"noll{j}" for j in indices]
    return Pupil(pupil.transmission, pupil.diameter, pupil.opd, basis, names, light=float(pupil.light))
