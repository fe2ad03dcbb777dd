"""What a model leaves out of a frame, as changes of the expected image.

Reach for :func:`effects_of`; :data:`KINDS_OF_EFFECT` has what there is.  The changes are made by the one
forward model with the effect put in: another pupil, spectrum, plate scale or scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jitterkit.conventions import offsets
from jitterkit.detectors.response import broaden, couple
from jitterkit.errors import ConfigurationError, ErrorCode, did_you_mean
from jitterkit.forecast.modelled import Modelled, of_sources
from jitterkit.forward import GRADIENT, expected_image
from jitterkit.loci import Skewed, principal_axes
from jitterkit.loci.cumulants import WithCumulants
from jitterkit.optics.colours import WAVELENGTH, Colours
from jitterkit.optics.otf import PLATE_SCALE
from jitterkit.optics.pupil import noll_to_nm, zernike
from jitterkit.optics.spectrum import Spectrum
from jitterkit.optics.system import OpticalSystem
from jitterkit.scene import Binary, Star

_DIRECTIONS = 8
"""Around the pair, in which a third star may stand: its bias differs in sign from one to the next."""

_STEP = 1e-3
"""Share of a pixel by which an image is moved for its slope: the third derivative weighs 1e-7."""


class Effect(NamedTuple):
    """Something that a model leaves out, or holds wrong by one standard deviation.

    Attributes
    ----------
    name : str
    size : float
    unit : str
        Of the size, as astropy reads it; empty for a pure number.
    changes : (m, ny, nx) array
        Of the image, in electrons: independent of each other, by one standard deviation each.
    hold : tuple of str
        Parameters that describe the effect in a fit, if they are free.
    per_pixel : bool
        Whether a change is one of each pixel, independent of the others.
    together : bool
        Whether all changes are there at once; else one of them is, whichever.
    opposite : (m, ny, nx) array or None
        Changes by the opposite sign of the size; None where they are as large as the others.
    """

    name: str
    size: float
    unit: str
    changes: np.ndarray
    hold: tuple[str, ...] = ()
    per_pixel: bool = False
    together: bool = True
    opposite: np.ndarray | None = None


class _Kind(NamedTuple):
    """A kind of effect: usual size, and what makes its changes; None of what cannot be.

    What is ``curved`` may show by the square of its size, as even modes do about a pupil that is its own
    mirror image, a wavelength whose first order a fit takes up, and a turn to both sides.
    """

    size: float
    unit: str
    changes: Callable[[Modelled, float], list[np.ndarray] | None]
    hold: tuple[str, ...] = ()
    per_pixel: bool = False
    together: bool = True
    curved: bool = False


def effects_of(model: Modelled, sizes: Mapping[str, float] | None = None) -> Iterator[Effect]:
    """Yield the effects that a model may lack.

    Parameters
    ----------
    model : Modelled
    sizes : mapping of name to float, optional
        In place of the usual ones; that of the plate scale is usually its stated error, if there is one.

    Raises
    ------
    ConfigurationError
        If there is no effect of a name, or a size is not positive.
    """
    kinds, stated = KINDS_OF_EFFECT | _modes(model), model.telescope.plate_scale_err
    sizes = ({"plate_scale": stated} if stated else {}) | dict(sizes or {})
    for name, size in sizes.items():
        if name not in kinds:
            problem = f"There is no effect {name!r}; {did_you_mean(name, kinds)}there are {', '.join(kinds)}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
        if not 0 < size < math.inf:
            problem = f"The size of {name} is {size}; give a positive number."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    for name, kind in kinds.items():
        size = sizes.get(name, kind.size)
        changes = kind.changes(model, size)
        if changes is not None:
            opposite = np.array(kind.changes(model, -size)) if kind.curved else None
            how = kind.hold, kind.per_pixel, kind.together, opposite
            yield Effect(name, size, kind.unit, np.array(changes), *how)


def _modes(model: Modelled) -> dict[str, _Kind]:
    """Modes of the wavefront that no parameter describes, to the end of the next order, at least Noll 22."""
    names = set(model.otf.names) - set(model.otf.blind())
    fitted = [int(name[4:]) for name in names if name.startswith("noll") and name[4:].isdecimal()]
    order = noll_to_nm(max(fitted, default=3) + 1)[0]
    last = max(22, (order + 1) * (order + 2) // 2)
    modes = [j for j in range(4, last + 1) if f"noll{j}" not in names]
    return {f"noll{j}": _Kind(1.0, "nm", partial(_wavefront, (j,)), curved=True) for j in modes}


def _mode(model: Modelled, number: int) -> np.ndarray | None:
    """Return a mode of one nm over the model's pupil; None of a PSF, which has none."""
    if not isinstance(model.optics, OpticalSystem):
        return None
    samples = len(model.optics.pupil.transmission)
    axis = offsets(samples, 2.0 / samples)
    return zernike(number, *np.meshgrid(axis, axis))


def _wavefront(modes: tuple[int, ...], model: Modelled, size: float, scene: Star | None = None):
    planes = [_mode(model, number) for number in modes]
    return [model.with_opd(size * plane, scene) for plane in planes if plane is not None] or None


def _of_b(modes: tuple[int, ...], model: Modelled, size: float):
    x, y, flux = (part[1] for part in model.parameters.scene.stars())
    indices = model.parameters.scene.indices
    return _wavefront(modes, model, size, Star(x, y, flux, None if indices is None else indices[1:2]))


def _focus_change(model: Modelled, size: float):
    plane = _mode(model, 4)
    if plane is None:
        return None
    return [(model.with_opd(size * plane) + model.with_opd(-size * plane)) / 2]


def _amplitude(model: Modelled, size: float):
    if not isinstance(model.optics, OpticalSystem):
        return None
    pupil, changes = model.optics.pupil, []
    slope = 1 + size * np.linspace(-1, 1, len(pupil.transmission))
    for tilted in (pupil.transmission * slope, pupil.transmission * slope[:, None]):
        optics = replace(model.optics, pupil=eqx.tree_at(lambda p: p.transmission, pupil, tilted))
        changes.append(model.through(optics) - model.image)
    return changes


def _plate_scale(model: Modelled, size: float):
    scale = model.otf.grid.plate_scale * (1 + size)
    return [model.through(model.telescope.system(plate_scale=scale)) - model.image]


def _spectrum(change: Callable[[np.ndarray, float], np.ndarray], model: Modelled, size: float):
    if not isinstance(model.optics, OpticalSystem):
        return None
    light = model.optics.spectrum
    other = Spectrum(tuple(change(np.array(light.wavelengths), size)), light.weights)
    return [model.through(replace(model.optics, spectrum=other)) - model.image]


def _index(star: int, model: Modelled, size: float):
    optics, p = model.optics, model.parameters
    if not (isinstance(optics, OpticalSystem) and optics.spectrum.has_colour):
        return None
    colours = optics.colours or Colours(wavelength_err=0.0)
    otf = replace(optics, colours=colours).otf(p.aberrations, derivatives=False)
    known = np.zeros(2) if p.scene.indices is None else np.asarray(p.scene.indices)
    scenes = [p.scene.coloured(known + step * (np.arange(2) == star)) for step in (size, 0.0)]
    after, before = (np.asarray(expected_image(of_sources(p, scene), otf)) for scene in scenes)
    return [after - before]


def _background(model: Modelled, size: float):
    return [np.full_like(model.image, size)]


def _gradient(model: Modelled, size: float):
    up, along = np.meshgrid(*(np.linspace(-size, size, n) for n in model.image.shape), indexing="ij")
    return [up, along]


def _third_star(model: Modelled, size: float):
    pair = model.parameters.binary
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    x, y = (float(pair.separation) * part(angles) for part in (np.cos, np.sin))
    flux = size * pair.stars()[2][0]
    stars = [Star(pair.x + dx, pair.y + dy, flux) for dx, dy in zip(x, y, strict=True)]
    return [model.of_scene(star) for star in stars]


def _moved(model: Modelled) -> list[np.ndarray]:
    """Return by how much an image changes that moves by a pixel along x, and along y."""
    scene, step = model.parameters.scene, _STEP * model.otf.grid.plate_scale
    return [
        (model.of_scene(scene.shifted(dx, dy)) - model.of_scene(scene.shifted(-dx, -dy))) / (2 * _STEP)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]


def _from_centre(model: Modelled) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets ``x`` (nx) and ``y`` (ny, 1) of pixels from the centre of the image."""
    y, x = (offsets(n, 1.0) for n in model.image.shape)
    return x, y[:, None]


def _stretch(model: Modelled, size: float):
    pairs = zip(_from_centre(model), _moved(model), strict=True)
    return [size * (model.image - at * moved) for at, moved in pairs]


def _shear(model: Modelled, size: float):
    (x, y), (along_x, along_y) = _from_centre(model), _moved(model)
    return [size * y * along_x, size * x * along_y]


def _roll(model: Modelled, size: float):
    pair, images = model.parameters.binary, []
    x, y, theta = float(pair.x), float(pair.y), float(pair.theta)
    for degrees in (size / 3600, -size / 3600):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        middle, light = (c * x - s * y, s * x + c * y), (pair.flux, pair.contrast)
        turned = Binary(pair.separation, theta + degrees, *middle, *light, indices=pair.indices)
        images.append(model.of_scene(turned))
    return [sum(images) / 2 - model.of_scene(pair)]


def _charge(change: Callable[[np.ndarray, float], np.ndarray], model: Modelled, size: float):
    return [change(model.image, size) - model.image]


def _skewness(model: Modelled, size: float):
    sigma, _, angle = principal_axes(model.parameters.locus.moments())
    if not sigma > 0:
        return None
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    cumulants = size * sigma**3 * np.array([c**3, c * c * s, c * s * s, s**3])
    skewed = WithCumulants(model.parameters.locus, (3,), cumulants)
    return [np.asarray(expected_image(model.parameters.with_locus(skewed), model.otf)) - model.image]


def _separation(change: Callable[[float, float], float], model: Modelled, size: float):
    pair = model.parameters.binary
    values = {name: getattr(pair, name) for name in pair.own}
    values["separation"] = change(float(pair.separation), size)
    if not values["separation"] > 0:
        problem = f"a change of the separation by {size:g} leaves none; give a smaller size"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"Velocity aberration or orbit: {problem}.")
    other = Binary(**values, indices=pair.indices)
    return [model.of_scene(other) - model.of_scene(pair)]


KINDS_OF_EFFECT: dict[str, _Kind] = {
    "plate_scale": _Kind(1e-5, "", _plate_scale, hold=(PLATE_SCALE,)),
    "wavelength": _Kind(
        1e-4, "", partial(_spectrum, lambda nm, by: nm * (1 + by)), hold=(WAVELENGTH,), curved=True
    ),
    "band": _Kind(1.0, "nm", partial(_spectrum, lambda nm, by: nm + by), hold=(WAVELENGTH,), curved=True),
    "index_a": _Kind(0.1, "", partial(_index, 0), hold=Binary.colours),
    "index_b": _Kind(0.1, "", partial(_index, 1), hold=Binary.colours),
    "coma_b": _Kind(1.0, "nm", partial(_of_b, (7, 8)), hold=("noll7_b", "noll8_b"), curved=True),
    "astigmatism_b": _Kind(1.0, "nm", partial(_of_b, (5, 6)), hold=("noll5_b", "noll6_b"), curved=True),
    "focus_change": _Kind(5.0, "nm", _focus_change, curved=True),
    "amplitude": _Kind(0.01, "", _amplitude, hold=("transmission_x", "transmission_y"), curved=True),
    "background": _Kind(1.0, "electron", _background, hold=("background", *GRADIENT)),
    "gradient": _Kind(1.0, "electron", _gradient, hold=GRADIENT),
    "third_star": _Kind(10 ** (-0.4 * 8), "", _third_star, together=False),
    "flat": _Kind(1e-3, "", lambda model, by: [by * model.image], per_pixel=True),
    "pixel_grid": _Kind(1e-3, "pix", lambda model, by: [by * np.hypot(*_moved(model))], per_pixel=True),
    "stretch": _Kind(1e-5, "", _stretch),
    "shear": _Kind(1e-5, "", _shear),
    "roll": _Kind(100.0, "arcsec", _roll, curved=True),
    "brighter_fatter": _Kind(1e-6, "pix/electron", partial(_charge, broaden)),
    "coupling": _Kind(5e-3, "", partial(_charge, couple)),
    "nonlinearity": _Kind(1e-2, "", partial(_charge, lambda held, by: held * (1 - by * held / held.max()))),
    "skewness": _Kind(0.2, "", _skewness, hold=Skewed.names[3:]),
    "velocity_aberration": _Kind(1e-4, "", partial(_separation, lambda now, by: now * (1 - by))),
    "orbit": _Kind(57e-6, "arcsec", partial(_separation, lambda now, by: now + by)),
}
"""By name, beside the modes of the wavefront that no parameter describes: ``noll11``."""
