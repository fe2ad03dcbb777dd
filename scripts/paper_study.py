"""What every part of the reproduction starts from and hands back.

Reach for :class:`Study`: the paper's scene in two numerics, the paper's and exact ones.  A part is a function
of it that returns a :class:`Part`: rows of the table, pictures, sentences on slips, timings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import paper_numbers as paper
from astropy.table import QTable
from matplotlib.figure import Figure
from paper_numerics import SampledOptics

from jitterkit.forecast import Forecast, forecast
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Locus, Stable
from jitterkit.optics import OpticalSystem, Pupil, grid_for, lines, toliman_pupil
from jitterkit.photons import annulus_area
from jitterkit.refit import FitOptions
from jitterkit.scene import Binary

MICRO = 1e6
"""µas in an arcsec."""

TARGET = 1e-6
"""arcsec: error of the mean separation that the mission is after."""

BAND, SAMPLES = (530.0, 640.0), 5
"""nm, and how many lines, both ends of the band among them: the paper's spectrum."""

FRAME, PLATE_SCALE = (128, 128), 0.375
"""Pixels, and arcsec per pixel."""

THETA = 180.0
"""Degrees: the pair lies along x, so that a jitter's angle is that from the pair."""


class Row(NamedTuple):
    """A line of the table; None where there is nothing to say."""

    quantity: str
    unit: str
    where: str
    paper: float | None
    public: float | None
    exact: float | None
    remark: str = ""


@dataclass
class Part:
    """What one part of the reproduction found.

    Attributes
    ----------
    rows : list of Row
    pictures : dict of name to (Figure, str)
        The picture and what it shows.
    tables : dict of name to QTable
        The numbers beside a picture.
    slips : dict of int to str
        Where the paper is wrong and why, with the measured numbers, by its place in the list.
    timings : list of (str, float)
        What was timed, and seconds.
    text : str
        What else there is to say, in Markdown.
    """

    rows: list[Row] = field(default_factory=list)
    pictures: dict[str, tuple[Figure, str]] = field(default_factory=dict)
    tables: dict[str, QTable] = field(default_factory=dict)
    slips: dict[int, str] = field(default_factory=dict)
    timings: list[tuple[str, float]] = field(default_factory=list)
    text: str = ""

    def add(self, quantity: str, unit: str, where: str, public, exact, *, paper=None, remark="") -> None:
        """Add a line of the table."""
        self.rows.append(Row(quantity, unit, where, paper, public, exact, remark))


AS_PUBLISHED = FitOptions(hold=("background",))
"""The paper's frames have no sky, and its fits know that."""


@dataclass(frozen=True)
class Study:
    """The paper's scene, in the paper's numerics and in exact ones.

    Attributes
    ----------
    exact : OpticalSystem
    sampled : SampledOptics
        With the public model's 4 x 4 points a pixel.
    draws : int
        Noisy frames of each panel of the cross-fit.
    skip_public : bool
        Whether to leave out the Hessian of the public model.
    seed : int
    coarse : bool
        Whether to sweep a few points only: for tests.
    """

    exact: OpticalSystem
    sampled: SampledOptics
    draws: int = int(paper.DRAWS.value)
    skip_public: bool = True
    seed: int = 0
    coarse: bool = False

    @property
    def area(self) -> float:
        """True collecting area, cm²."""
        return annulus_area(paper.DIAMETER, paper.OBSCURATION)

    @property
    def photons(self) -> float:
        """Of one frame, by the paper's rate and the true area."""
        return paper.RATE.value * self.area * paper.EXPOSURE.value

    def parameters(self, locus: Locus | None = None, flux: float = paper.PHOTONS.value) -> Parameters:
        """The scene under a jitter."""
        pair = Binary(paper.SEPARATION, THETA, 0.0, 0.0, flux, paper.CONTRAST)
        return Parameters(pair, locus or Stable.of(), np.zeros(len(self.exact.pupil.names)))

    def forecasts(self, public: Locus | None = None, exact: Locus | None = None, **scene) -> list[Forecast]:
        """Forecasts in the paper's numerics and in exact ones."""
        return [
            forecast(self.parameters(locus, **scene), optics.nominal, options=AS_PUBLISHED)
            for locus, optics in ((public, self.sampled), (exact, self.exact))
        ]

    def errors(self, public: Locus | None = None, exact: Locus | None = None, **scene) -> list[float]:
        """Errors of the separation, µas, likewise."""
        return [MICRO * found.error("separation") for found in self.forecasts(public, exact, **scene)]

    def images(self, public: Locus | None = None, exact: Locus | None = None, **scene) -> list[np.ndarray]:
        """Expected images, likewise."""
        return [
            np.asarray(expected_image(self.parameters(locus, **scene), optics.nominal))
            for locus, optics in ((public, self.sampled), (exact, self.exact))
        ]


PartOf = Callable[[Study], Part]


def study_of(pupil: Pupil | None = None, shape: tuple[int, int] = FRAME, **settings) -> Study:
    """The study of a pupil, TOLIMAN's unless another is given."""
    pupil = toliman_pupil(10) if pupil is None else pupil
    spectrum = lines(*np.linspace(*BAND, SAMPLES))
    grid = grid_for(pupil, spectrum, shape, PLATE_SCALE)
    return Study(OpticalSystem(pupil, spectrum, grid), SampledOptics(pupil, spectrum, grid), **settings)
