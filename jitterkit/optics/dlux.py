"""A dLux optical system as a :class:`~jitterkit.optics.pupil.Pupil`.

A wavefront of 0.1 mm wavelength is sent through the system's layers: so long that no phase wraps,
so that its amplitude and phase *are* the transmission and the path difference, whatever the layers
are called.  Sent through again in visible light, with every coefficient moved, the system must agree
with the pupil; one that does not is refused.

Only attributes of the system are used, and dLux itself is never imported here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.pupil import Pupil

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
