"""Everything about one frame that may be fitted: as a record, and as a vector with names."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.precision import real
from jitterkit.scene import Binary, Scene
from jitterkit.shutter import Shutter

GRADIENT = ("background_x", "background_y")
"""Names of the gradient of the background along each axis."""


class Parameters(eqx.Module):
    """Everything about one frame that may be fitted.

    Attributes
    ----------
    scene : Scene
    locus : Locus
    aberrations : (k,) array
        nm, in the order of the OTF's names.
    background : float
        Electrons per pixel, at the centre of the frame.
    gradient : (2,) array
        Of the background along x and y, electrons per pixel per arcsec.
    diffusion : float, optional
        Variance per axis, arcsec², of the charge's diffusion beyond what the OTF holds; signed, because the
        OTF may hold too much.  None if there is no such parameter.
    shutter : Shutter, optional
        When which row was exposed, and to what motion; known, not fitted.  None for a global shutter.
    """

    scene: Scene
    locus: Locus
    aberrations: Float[Array, " k"]
    background: Float[Array, ""]
    gradient: Float[Array, "2"]
    diffusion: Float[Array, ""] | None
    shutter: Shutter | None

    def __init__(
        self,
        scene: Scene,
        locus: Locus,
        aberrations=(),
        background=0.0,
        *,
        gradient=(0.0, 0.0),
        diffusion=None,
        shutter: Shutter | None = None,
    ) -> None:
        self.scene, self.locus, self.shutter = scene, locus, shutter
        self.aberrations, self.background, self.gradient = map(real, (aberrations, background, gradient))
        self.diffusion = None if diffusion is None else real(diffusion)

    def with_locus(self, locus: Locus) -> Parameters:
        """The same with another locus."""
        return replace(self, locus=locus)

    def shifted(self, dx: float, dy: float) -> Parameters:
        """The same with stars and background moved by ``dx, dy`` arcsec."""
        level = self.background - self.gradient @ np.array([dx, dy])
        return replace(self, scene=self.scene.shifted(dx, dy), background=level)

    def completed(self, otf: OTF) -> Parameters:
        """The same with what the optics know beforehand and these lack: colours, and what is no mode."""
        coloured = eqx.tree_at(lambda p: p.scene, self, otf.with_colours(self.scene))
        if not otf.further or len(self.aberrations) != len(otf.names) - len(otf.further):
            return coloured
        every = jnp.concatenate([self.aberrations, jnp.zeros(len(otf.further))])
        return eqx.tree_at(lambda p: p.aberrations, coloured, every)

    def implausible(self, shape: tuple[int, int], plate_scale: float) -> str:
        """Say what no frame can show, however well these parameters fit it.

        Parameters
        ----------
        shape : (int, int)
            ``(ny, nx)`` of the frame.
        plate_scale : float
            arcsec/pixel.

        Returns
        -------
        problem : str
            Stars outside the frame, or a blur as wide as it is: half a sentence.  Empty if all is well.
        """
        scene, half = self.scene, (np.array(shape[::-1]) - 1) / 2 * plate_scale
        x, y, _ = map(np.asarray, scene.sources())
        middle = np.abs(np.array([float(scene.x), float(scene.y)]))
        if not np.all(middle <= half) or np.hypot(np.ptp(x), np.ptp(y)) > 2 * np.hypot(*half):
            return "it puts the stars outside the frame"
        major, _, _ = principal_axes(self.locus.moments())
        if 4 * major > 2 * half.max():
            return f"it blurs them by {major:.3g} arcsec rms, a quarter of the frame"
        return ""

    @property
    def binary(self) -> Binary:
        """The scene, where it is a binary."""
        if not isinstance(self.scene, Binary):
            raise TypeError(f"The scene is a {type(self.scene).__name__}, not a binary.")
        return self.scene


def parameter_names(parameters: Parameters, aberrations: tuple[str, ...]) -> tuple[str, ...]:
    """Name of each element of :func:`to_vector`."""
    last = ("background", *GRADIENT, *["diffusion"] * (parameters.diffusion is not None))
    aberrations = aberrations[: len(parameters.aberrations)]
    return (*parameters.scene.names, *parameters.locus.names, *aberrations, *last)


def held_with(hold: Collection[str]) -> set[str]:
    """Return names to hold, and those that mean nothing without them: a background's gradient."""
    return {*hold, *GRADIENT * ("background" in hold)}


def free_parameters(
    parameters: Parameters, otf: OTF, hold: Collection[str] = ()
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The parameters a fit may vary.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
    hold : collection of str
        Names to keep as they are.

    Returns
    -------
    names : tuple of str
    free : tuple of int
        Their positions in :func:`to_vector`.  An aberration that the image does not show to first
        order is not among them: defocus or astigmatism about perfect focus, for a pupil that is its
        own mirror image, where both signs look the same.  Nor is what B has more of a mode than A, where
        there is no B, nor the gradient of a background that is held.

    Raises
    ------
    ConfigurationError
        If a name to hold names nothing, every one is held, or the optics have other aberrations than the
        parameters.
    """
    if len(otf.names) - len(parameters.aberrations) not in (0, len(otf.further)):
        raise ConfigurationError(
            ErrorCode.WRONG_SHAPE,
            f"The parameters hold {len(parameters.aberrations)} aberrations but the optics {len(otf.names)}; "
            "give one value for each.",
        )
    every = parameter_names(parameters, otf.names)
    unknown = [name for name in hold if name not in every]
    if unknown:
        problem = f"There is no parameter {unknown[0]!r} to hold; there are {', '.join(every)}."
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
    colours = parameters.scene.colours
    known = colours if otf.tints is None or otf.colours is None else otf.colours.held(colours)
    nothing = set(otf.names) - set(otf.varied(parameters.scene))
    held = {*held_with(hold), *known, *otf.blind(), *nothing}
    free = tuple(i for i, name in enumerate(every) if name not in held)
    problem = f"Every parameter is held ({', '.join(every)}); leave one free, such as the flux."
    refuse_if(not free, ErrorCode.TOO_FEW, problem)
    return tuple(every[i] for i in free), free


def to_vector(parameters: Parameters):
    """Parameters as one vector, and the function that undoes it.

    Returns
    -------
    vector : (p,) array
        In the order of :func:`parameter_names`.
    unravel : callable
        Keeps what a locus holds beside its coordinates, a measured trace say, and the shutter.
    """
    locus = parameters.locus
    last = (parameters.background, parameters.gradient, parameters.diffusion)
    varied = (parameters.scene, locus.coords, parameters.aberrations, *last)
    vector, unravel = jax.flatten_util.ravel_pytree(varied)

    def rebuild(values) -> Parameters:
        scene, coords, *rest, diffusion = unravel(values)
        aberrations, background, gradient = rest
        return Parameters(
            scene,
            locus.at(coords),
            aberrations,
            background,
            gradient=gradient,
            diffusion=diffusion,
            shutter=parameters.shutter,
        )

    return vector, rebuild
