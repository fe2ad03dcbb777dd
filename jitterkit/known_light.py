"""What a frame shows beside its model and what is known beforehand: displaced pixels, stars of a catalogue.

Both depend on where the stars of the frame are.  A simulation adds them to an image.  A fit takes them out of
its frame, as its first result has them, and is repeated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.detectors.knowledge import piece
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, displacement_effect, expected_image
from jitterkit.frames.sky import sky_position_angle
from jitterkit.instruments.background_stars import BackgroundStars
from jitterkit.instruments.instrument import Instrument
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Stars

if TYPE_CHECKING:
    from jitterkit.frames.frame import Frame


@dataclass(frozen=True, eq=False)
class KnownLight:
    """Hold the known light of a frame beside its model.  Build it with :meth:`of`.

    Attributes
    ----------
    shifts : pair of (ny, nx) arrays or None
        Displacements of the detector's pixels along x and y, pixels; None for none.
    stars : BackgroundStars or None
    """

    shifts: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    stars: BackgroundStars | None = None

    @classmethod
    def of(cls, instrument: Instrument) -> KnownLight | None:
        """Return what an instrument knows; None if it is nothing."""
        detector, stars = instrument.detector, None if instrument.sky is None else instrument.sky.stars
        shifts = detector.pixel_shift_x, detector.pixel_shift_y
        return cls(shifts, stars) if any(part is not None for part in (*shifts, stars)) else None

    def image(
        self,
        parameters: Parameters,
        otf: OTF,
        *,
        frame: Any = "a simulated frame",
        origin: tuple[int, int] = (0, 0),
        wcs: Any = None,
    ) -> np.ndarray:
        """Return what it adds to an expected image.

        Parameters
        ----------
        parameters : Parameters
        otf : OTF
        frame : str or Path
            Named in complaints.
        origin : (int, int)
            ``(x0, y0)`` of the frame on the detector.
        wcs : astropy.wcs.WCS, optional
            Of the detector's pixels, from 0.

        Returns
        -------
        image : (ny, nx) array
            Electrons.

        Raises
        ------
        FrameError
            If a map does not cover the frame.
        ConfigurationError
            If nothing says how the frame is turned on the sky.
        """
        grid, added = otf.grid, np.zeros(otf.grid.shape)
        if self.stars is not None:
            others = _placed(self.stars, parameters, grid, origin, wcs)
            if others is not None:
                stars = Parameters(
                    others,
                    parameters.locus,
                    parameters.aberrations,
                    0.0,
                    diffusion=parameters.diffusion,
                    shutter=parameters.shutter,
                )
                added = np.array(expected_image(stars.completed(otf), otf))
        if any(shift is not None for shift in self.shifts):
            names = ("pixel_shift_x", "pixel_shift_y")
            dx, dy = (
                np.zeros(grid.shape) if shift is None else piece(name, shift, frame, origin, grid.shape)
                for name, shift in zip(names, self.shifts, strict=True)
            )
            added += displacement_effect(parameters, otf, dx * grid.plate_scale, dy * grid.plate_scale)
        return added

    def of_frame(self, frame: Frame, parameters: Parameters, otf: OTF) -> np.ndarray:
        """Return :meth:`image` for a frame, as a fit of it has its stars."""
        where = {"frame": frame.name, "origin": frame.origin, "wcs": frame.metadata.wcs}
        return self.image(parameters, otf, **where)


def without_light(frame: Frame, light: np.ndarray) -> Frame:
    """Return a frame without known light (ny, nx) [electrons].

    Its counts keep their photon noise: the likelihood of a frame is that of what was counted.
    """
    variance = np.maximum(frame.read_variance + light * frame.response, 0.0)
    return replace(frame, electrons=frame.electrons - light, read_variance=variance)


def _placed(stars: BackgroundStars, p: Parameters, grid: Grid, origin: tuple[int, int], wcs: Any):
    """Return the stars of a catalogue as a scene; None where none of them is on the modelled field."""
    x, y, flux = (float(part[0]) for part in p.scene.stars())
    theta, angle, mirrored = 0.0, stars.pair_angle, stars.mirrored
    if wcs is not None and not stars.in_frame:
        column, row = (
            first + (n - 1) / 2 + offset / grid.plate_scale
            for first, n, offset in zip(origin, grid.shape[::-1], (x, y), strict=True)
        )
        angle, quarter = (sky_position_angle(wcs, column, row, turn) for turn in (0.0, 90.0))
        mirrored = (quarter - angle) % 360.0 > 180.0
    elif isinstance(p.scene, Binary):
        theta = float(p.scene.theta)
    else:
        angle = None
    if stars.in_frame and not isinstance(p.scene, Binary):
        problem = "the stars of [sky] cannot be placed by their angle_from_b in a frame that shows no pair"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; give their position_angle.")
    if angle is None or math.isnan(angle):
        pair = isinstance(p.scene, Binary)
        remedy = "give the pair_angle of B in [sky]" if pair else "a frame that shows no pair needs one"
        problem = "the stars of [sky] cannot be placed, because the frame has no WCS of the stars"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; {remedy}.")
    dx, dy = stars.offsets(theta, angle, mirrored)
    light = flux * 10 ** (-0.4 * stars.delta_mag)
    reach = [(n / 2 + grid.pad) * grid.plate_scale for n in grid.shape[::-1]]
    near = (np.abs(x + dx) < reach[0]) & (np.abs(y + dy) < reach[1])
    return Stars.of((x + dx)[near], (y + dy)[near], light[near]) if near.any() else None
