"""The paper's numerics in the language of transfer functions: its pixels, streaks, normals and area.

Reach for :class:`SampledOptics` in place of an optical system, and for :data:`PUBLIC_LOCI` in place of the
exact loci.  They are wrong by up to hundreds of microarcseconds, and stand outside the package for that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from arcsine import arcsine_shares

from jitterkit.loci import Locus, Mvn
from jitterkit.loci.special import sinc_of_square
from jitterkit.loci.streak import Streak
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import OpticalSystem
from jitterkit.photons import annulus_area

NODES = np.linspace(-0.5, 0.5, 5)
"""Places of the five images, in lengths: both ends of the streak are among them."""

CELLS = np.concatenate([NODES[:1], (NODES[1:] + NODES[:-1]) / 2, NODES[-1:]])
"""Edges of the cells about them; the first and the last are half as wide."""

SAMPLES, SAMPLES_OF_NORMAL = 4, 6
"""Points along the side of a pixel: of the public model, and under the paper's normal jitter."""


class FiveImages(Streak):
    """Five images along a streak, equally spaced from end to end.

    Attributes
    ----------
    weights : (5,) array
        Class attribute.
    """

    weights: ClassVar[np.ndarray]

    def transfer(self, fx, fy):
        square = self.variance_along(fx, fy) / self.variance
        # cos(2 pi q) = 1 - 2 sin²(pi q), in squares for the sake of derivatives at zero length
        waves = [
            1 - 2 * np.pi**2 * node**2 * square * sinc_of_square(node**2 * square) ** 2 for node in NODES
        ]
        return sum(weight * wave for weight, wave in zip(self.weights, waves, strict=True))

    def points(self, n: int) -> np.ndarray:
        return self._placed(np.repeat(NODES, np.rint(n * self.weights).astype(int)))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self.points(n)


class FiveEqualImages(FiveImages):
    """The paper's linear jitter: equal weights, so that the variance is ``L²/8`` and not ``L²/12``."""

    names: ClassVar[tuple[str, ...]] = ("linear_c", "linear_s")
    weights: ClassVar[np.ndarray] = np.full(5, 0.2)
    variance: ClassVar[float] = float(weights @ NODES**2)


class FiveArcsineImages(FiveImages):
    """The paper's harmonic jitter: each image weighs as long as the motion stays in its cell."""

    names: ClassVar[tuple[str, ...]] = ("shm_c", "shm_s")
    weights: ClassVar[np.ndarray] = arcsine_shares(CELLS, 0.5)
    variance: ClassVar[float] = float(weights @ NODES**2)


PUBLIC_LOCI: dict[str, type[FiveImages]] = {"linear": FiveEqualImages, "shm": FiveArcsineImages}


def point_sampled(otf: OTF, samples: int = SAMPLES) -> OTF:
    """Replace the integral over a pixel by the mean over ``samples`` x ``samples`` points in it.

    The points are centres of equal cells, whose mean has the transfer function sinc(fp) / sinc(fp/samples).
    """
    fy, fx = otf.grid.frequencies
    p = otf.grid.plate_scale
    pixel = np.sinc(p * fx) * np.sinc(p * fy) / (np.sinc(p * fx / samples) * np.sinc(p * fy / samples))
    return replace(otf.multiplied(pixel), pixel_included=True)


@dataclass(frozen=True)
class SampledOptics(OpticalSystem):
    """An optical system whose pixels are sampled at points."""

    samples: int = SAMPLES

    @cached_property
    def nominal(self) -> OTF:
        return self.otf(np.zeros(len(self.pupil.names)))

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        return point_sampled(super().otf(aberrations, derivatives=derivatives), self.samples)


def normal_of_shear(sigma_major: float, shear: float, angle: float = 0.0) -> Locus:
    """The paper's normal of a shear: ``sigma_min² = sigma_maj² (1 - shear)``, against its own definition."""
    return Mvn.of(sigma_major, sigma_major * np.sqrt(1 - shear), angle)


def normal_of_construction(determinant: float, shear: float, angle: float = 0.0) -> Locus:
    """The paper's normal of a determinant [arcsec⁴]: ``sigma_maj² = sqrt(det) / (1 - shear)``."""
    return normal_of_shear(np.sqrt(np.sqrt(determinant) / (1 - shear)), shear, angle)


def area_of_diameters_as_radii(diameter: float, obscuration: float) -> float:
    """The paper's area [cm²] of diameters [m] that it takes for radii."""
    return annulus_area(2 * diameter, 2 * obscuration)
