"""Frames from the forward model, with fits whose every number is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, parameter_names
from jitterkit.frames.frame import Frame
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.optics import expand, grid_for
from jitterkit.optics.pupil import obstructed_circle
from jitterkit.optics.spectrum import lines
from jitterkit.refit.result import Candidate, FitResult, Status
from jitterkit.scene import Binary

PLATE_SCALE = 0.375
ABERRATIONS = np.arange(4.0, 11.0)  # nm: Noll 4 is 4 nm
LOCI = {
    "linear": Linear.of(0.75, 30.0),
    "shm": Shm.of(0.6, 110.0),
    "mvn": Mvn.of(0.2, 0.09, 60.0),
    "stable": Stable.of(),
}
ERRORS = {"separation": 2.4e-4, "theta": 0.002, "x": 1e-4, "y": 2e-4, "flux": 7000.0, "contrast": 0.0004}


@dataclass(frozen=True)
class Maker:
    """Makes noisy frames and results that carry the truth as if it had been fitted."""

    otf: object

    def __call__(self, locus="linear", seed=0, path="frame.fits", index=0, several=False):
        """``(frame, result)``; the separation errs by its error, drawn with ``seed``."""
        rng = np.random.default_rng(seed)
        separation = 8.1 + ERRORS["separation"] * rng.normal()
        scene = Binary(separation, 37.0, 1.5, -0.8, 3.811e7, 3.37)
        truth = Parameters(scene, LOCI[locus], ABERRATIONS, 400.0)
        image = np.asarray(expected_image(truth, self.otf))
        electrons = rng.poisson(image).astype(float)
        mask = np.zeros(image.shape, bool)
        mask[10, 20:25] = True
        names = parameter_names(truth, self.otf.names)[:-3]  # the background is held
        errors = np.array([ERRORS.get(n, 1e-5 if n in truth.locus.names else 0.05) for n in names])
        residual = np.where(mask, np.nan, (electrons - image) / np.sqrt(image))
        tried = (Candidate("stable", 9.1e6, 0.0, 8.3), Candidate(locus, 4080.5, 0.96, separation))
        result = FitResult(
            Status.OK,
            "fitted in 6 steps",
            flags=("jitter_undetected",) if locus == "stable" else (),
            locus=locus,
            parameters=truth,
            names=names,
            aberrations=self.otf.names,
            covariance=np.diag(errors**2),
            crlb=0.98 * errors,
            chi2=float(np.nansum(residual**2)),
            dof=int(np.sum(~mask)) - len(names),
            image=image,
            residual=residual,
            candidates=tried,
            iterations=6,
            seconds=0.25,
        )
        frame = Frame(electrons, 0.0, mask, 0.1, PLATE_SCALE, path=Path(path), index=index, several=several)
        return frame, result


@pytest.fixture(scope="session")
def make_fit():
    # a telescope of its own, with seven aberrations: tables and pictures show them all; nothing is fitted
    pupil = obstructed_circle(0.125, 0.03, struts=3, strut_width=0.004, samples=64)
    spectrum = lines(545.0, 585.0, 625.0)
    grid = grid_for(pupil, spectrum, (48, 48), PLATE_SCALE, pad=8)
    return Maker(expand(pupil, spectrum, grid, ABERRATIONS))
