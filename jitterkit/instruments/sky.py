"""The table ``[sky]`` of an instrument file: what moves a separation on the sky, and no frame shows.

::

    [sky]                              # all optional
    target = [219.9021, -60.8340]      # deg: right ascension and declination, ICRS
    velocity = "earth"                 # or [vx, vy, vz], km/s, barycentric, along the axes of ICRS
    orbit_rate = 0.5                   # arcsec a year (365.25 days), positive where the separation grows
    orbit_epoch = "2026-01-01"         # to which separations are reduced, UTC
    stars = "stars.csv"                # separation and position_angle from A, delta_mag: to be left out
    pair_angle = 12.3                  # deg, position angle of B, for stars in frames without a WCS
    mirrored = false                   # whether east is clockwise from north in these
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.constants import c

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.times import epoch_seconds
from jitterkit.instruments.background_stars import BackgroundStars, read_background_stars
from jitterkit.instruments.section import Section

SKY_KEYS: Mapping[str, str] = {
    "target": "deg",
    "velocity": "km/s",
    "orbit_rate": "arcsec/yr",
    "orbit_epoch": "",
    "stars": "",
    "pair_angle": "deg",
    "mirrored": "",
}
"""Keys of the table, with their units."""

_FASTEST = 1e-3 * c / 1e3
"""km/s, a thousandth of the speed of light: no observer in space is as fast."""

_YEAR = 365.25 * 86400
"""s."""

_EPOCH_1970 = 2440587.5
"""Julian date of the beginning of 1970, from which seconds are counted."""


@dataclass(frozen=True)
class Sky:
    """Hold the target's position, the observer's motion, and the change of the pair's separation.

    Parameters
    ----------
    target : (float, float), optional
        Right ascension and declination in ICRS, deg.
    velocity : (float, float, float) or "earth", optional
        Of the observer relative to the barycentre, km/s along the axes of ICRS; or that of the earth's
        centre at the time of each frame.
    orbit_rate : float, optional
        Change of the separation, arcsec a year.
    orbit_epoch : str, optional
        ISO 8601, UTC.
    stars : BackgroundStars, optional
        Whose light is taken out of the frames.

    Raises
    ------
    ConfigurationError
        If a number is impossible, or one of a pair is missing.
    """

    target: tuple[float, float] | None = None
    velocity: tuple[float, float, float] | str | None = None
    orbit_rate: float | None = None
    orbit_epoch: str | None = None
    stars: BackgroundStars | None = None

    def __post_init__(self) -> None:
        pairs = (("velocity", "target"), ("orbit_rate", "orbit_epoch"), ("orbit_epoch", "orbit_rate"))
        for one, other in pairs:
            if getattr(self, one) is not None and getattr(self, other) is None:
                raise ConfigurationError(ErrorCode.MISSING_VALUE, f"[sky] has {one} but no {other}; give it.")
        if self.target is not None and not (0 <= self.target[0] < 360 and abs(self.target[1]) <= 90):
            self._refuse("target", "give right ascension, 0 to 360, and declination, -90 to 90, in deg")
        if isinstance(self.velocity, str):
            if self.velocity != "earth":
                self._refuse("velocity", 'give "earth", or three numbers in km/s')
        elif (v := self.velocity) is not None and not (len(v) == 3 and math.hypot(*v) < _FASTEST):
            self._refuse("velocity", "give three numbers of less than 300 km/s together")
        if self.orbit_rate is not None and not abs(self.orbit_rate) < 100:
            self._refuse("orbit_rate", "give less than 100 arcsec a year")
        if self.orbit_epoch is not None and math.isnan(epoch_seconds(self.orbit_epoch)):
            self._refuse("orbit_epoch", 'give a date such as "2026-01-01"')

    def _refuse(self, key: str, remedy: str) -> None:
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"[sky] {key} = {getattr(self, key)!r}; {remedy}.")

    def va_factor(self, when: float) -> float | None:
        """Return by what a separation is multiplied to be that seen from the barycentre.

        Parameters
        ----------
        when : float
            Seconds since 1970, UTC; NaN where it is not known.

        Returns
        -------
        factor : float or None
            None where velocity, target or time are not known.
        """
        if self.target is None or self.velocity is None or (self.velocity == "earth" and math.isnan(when)):
            return None
        velocity = _of_earth(when) if self.velocity == "earth" else np.asarray(self.velocity)
        lon, lat = np.radians(self.target)
        direction = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
        return velocity_aberration(direction, velocity)

    def orbit_change(self, when: float) -> float | None:
        """Return by how much the separation has grown since the reference epoch [arcsec]; None if unknown."""
        if self.orbit_rate is None or self.orbit_epoch is None or math.isnan(when):
            return None
        return self.orbit_rate * (when - epoch_seconds(self.orbit_epoch)) / _YEAR


def velocity_aberration(direction: Any, velocity: Any) -> float:
    """Return by what small angles on the sky are multiplied to be those of an observer at rest.

    Parameters
    ----------
    direction : (3,) array
        Unit vector to the target, as seen at rest.
    velocity : (3,) array
        Of the observer, km/s along the same axes.

    Returns
    -------
    factor : float
        ``(1 + β·n)/sqrt(1 - β²)``: above one where the observer approaches the target, whose surroundings
        then look smaller.  It is the same for all position angles, and these stay as they are.

    Notes
    -----
    That of HST's ``VAFACTOR`` and JWST's ``VA_SCALE``, by which their pipelines multiply an image's scale.
    """
    beta = np.asarray(velocity) / (c / 1e3)
    return float((1 + beta @ np.asarray(direction)) / math.sqrt(1 - beta @ beta))


def _of_earth(when: float) -> np.ndarray:
    """Velocity of the earth's centre [km/s]; a minute between time scales changes it by 3e-9 of c."""
    from astropy.coordinates import get_body_barycentric_posvel  # slow to import, and seldom needed
    from astropy.time import Time

    time = Time(_EPOCH_1970, when / 86400, format="jd", scale="tdb")
    return get_body_barycentric_posvel("earth", time)[1].xyz.to_value("km/s")


def read_sky(section: Section) -> dict[str, Any]:
    """Read the table.

    Raises
    ------
    ConfigurationError
        If a value is of the wrong type or impossible, or one of a pair is missing.
    """
    velocity = section.values.get("velocity")
    if velocity is not None and not isinstance(velocity, str):
        velocity = tuple(section.numbers("velocity", 3))
    pair_angle, mirrored = section.number("pair_angle"), section.truth("mirrored")
    for key in ("pair_angle", "mirrored"):
        if key in section and "stars" not in section:
            section.refuse(ErrorCode.MISSING_VALUE, key, "give the table of stars too, or leave it out")
    return {
        "sky": Sky(
            tuple(section.numbers("target", 2)) if "target" in section else None,  # type: ignore[arg-type]
            velocity,
            section.number("orbit_rate"),
            section.text("orbit_epoch"),
            read_background_stars(section.path("stars"), pair_angle, bool(mirrored))
            if "stars" in section
            else None,
        )
    }
