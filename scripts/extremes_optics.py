"""Rows of ``scripts/extremes``: aberrations, wavelengths, and frames from the smallest to the largest."""

from __future__ import annotations

import resource
import time

import numpy as np
from extremes_checks import STATE, Check, binary, finite, fitted, image_of, near, recovered, telescope
from extremes_references import direct
from extremes_table import TELESCOPE, UNRESOLVED, row

from jitterkit.batch import FrameProcessor
from jitterkit.forward import Parameters, image_and_jacobian
from jitterkit.loci import Linear, Stable
from jitterkit.optics import Spectrum, flat_band, lines
from jitterkit.scene import Star
from jitterkit.simulate import simulate_frame

FULL = 4096


@row("aberrations of a wave", "Fraunhofer's integral; slopes of exact images; the truth or a status")
def a_wave():
    state, fine = np.array([585.0, -585.0]), telescope(samples=256)
    otf = fine.optics(state, pad=192)
    scene, step = Star(0.4, -0.6, 1e6), np.array([0.02, 0.0])
    image, jacobian = image_and_jacobian(Parameters(scene, Stable.of(), state), otf, (3,))
    sides = [image_of(scene, Stable.of(), fine.optics(state + side, pad=192)) for side in (step, -step)]
    return [
        near("against the integral", image, direct(fine, state, scene), 1e-5),
        near("slope", jacobian[0], (sides[0] - sides[1]) / 0.04, 1e-6),
        finite(binary(), Linear.of(0.6, 25.0), otf),
        fitted(TELESCOPE, binary(), aberrations=[100.0, 0.0]),
        fitted(TELESCOPE, binary(), aberrations=state, ends=UNRESOLVED),
    ]


@row("8 x 8 pixels", "Fraunhofer's integral; the truth; 7 x 7 are too few")
def tiny_frame():
    scene, tiny = binary(separation=1.2, x=0.0, y=0.1), telescope((8, 8), samples=256)
    found = image_of(scene, Stable.of(), tiny.optics(STATE, pad=192))
    return [
        near("against the integral", found, direct(tiny, STATE, scene), 1e-5),
        finite(scene, Linear.of(0.6, 25.0), tiny.optics(STATE)),
        fitted(tiny, scene),
        fitted(telescope((7, 7)), scene, ends=("NO_DATA",)),
    ]


@row(f"{FULL} x {FULL} pixels", "the middle of it; cut to the stars: the truth; < 2 min, < 4 GB", alone=True)
def huge_frame():
    began = time.perf_counter()
    fine = {"scale": 0.05, "samples": 256, "spectrum": lines(550.0), "read_noise": 2.0, "bias": 100.0}
    camera, region = telescope((FULL, FULL), **fine), telescope((128, 128), **fine)
    scene = binary(separation=3.0)
    otf = camera.optics(derivatives=False, pad=0)
    drawn = simulate_frame(camera, scene, Linear.of(0.3, 25.0), rng=np.random.default_rng(1), otf=otf)
    _, slope = image_and_jacobian(drawn.truth, otf, (0,))
    whole = bool(np.all(np.isfinite(drawn.expected)) and np.all(np.isfinite(np.asarray(slope))))
    wide = region.optics(pad=1024, derivatives=False)
    truth = Parameters(scene, Linear.of(0.3, 25.0), np.zeros(2))
    inner, inner_slope = (np.asarray(array) for array in image_and_jacobian(truth, wide, (0,)))
    middle = slice((FULL - 128) // 2, (FULL + 128) // 2)
    checks = [
        near("image", drawn.expected[middle, middle], inner, 1e-6),
        near("slope", np.asarray(slope)[0, middle, middle], inner_slope[0], 1e-6),
        recovered(FrameProcessor(region, locus="linear").process(drawn.raw).result, 3.0),
    ]
    spent, memory = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    return [
        *checks,
        Check(f"finite; {spent:.0f} s, {memory:.1f} GiB", whole and spent < 120 and memory < 3.7),
    ]


@row("one wavelength", "Fraunhofer's integral; the truth")
def one_wavelength():
    mono = telescope(spectrum=lines(585.0), samples=256)
    otf = mono.optics(STATE, pad=192)
    return [
        near(
            "against the integral",
            image_of(binary(), Stable.of(), otf),
            direct(mono, STATE, binary()),
            1e-5,
        ),
        finite(binary(), Linear.of(0.6, 25.0), otf),
        fitted(mono, binary()),
    ]


@row("a hundred wavelengths", "the integral over the band, by 400 midpoints; the truth")
def hundred_wavelengths():
    middles = 530 + 110 * (np.arange(400) + 0.5) / 400
    band, dense = (
        telescope(spectrum=s, samples=128, noll=())
        for s in (flat_band(530, 640, 100), Spectrum(tuple(middles), (1.0,) * 400))
    )
    otf = band.optics()
    return [
        near(
            "against midpoints",
            image_of(binary(), Stable.of(), otf),
            image_of(binary(), Stable.of(), dense.optics()),
            1e-5,
        ),
        finite(binary(), Linear.of(0.6, 25.0), otf),
        fitted(band, binary()),
    ]
