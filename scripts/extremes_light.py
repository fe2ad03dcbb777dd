"""Rows of ``scripts/extremes``: light and noise, and pairs that hardly are pairs."""

from __future__ import annotations

import numpy as np
from extremes_checks import STATE, Check, binary, finite, fitted, image_of, near, refused, telescope
from extremes_references import direct
from extremes_table import OTF, ROUNDING, TELESCOPE, UNRESOLVED, row

from jitterkit.batch import FrameProcessor
from jitterkit.loci import Linear, Shm, Stable
from jitterkit.scene import Star
from jitterkit.simulate import simulate_frame


def few(photons: float, seeds: int) -> list[Check]:
    """Several frames: as many may be fitted as will, but none wrongly."""
    scene = binary(flux=photons)
    checks = [fitted(TELESCOPE, scene, seed=seed, ends=(*UNRESOLVED, "NO_DATA")) for seed in range(seeds)]
    return [finite(scene, Stable.of(), OTF), *checks]


@row("1 photon", "finite; no separation")
def one_photon():
    return few(1.0, 3)


@row("100 photons", "the truth within its error, or a status")
def hundred_photons():
    return few(100.0, 4)


@row("1e12 photons", "the truth; the error falls as 1/√N; a detector without a range holds them")
def many_photons():
    errors = {}
    for photons in (1e8, 1e12):
        frame = simulate_frame(TELESCOPE, binary(flux=photons), Stable.of(), detector=False)
        errors[photons] = FrameProcessor(TELESCOPE, locus="mvn").process(frame.raw).result.error("separation")
    ratio = errors[1e8] / errors[1e12]
    return [
        finite(binary(flux=1e12), Linear.of(0.6, 25.0), OTF),
        Check(f"error of 1e8 over that of 1e12 photons: {ratio:.3f}", abs(ratio / 100 - 1) < 0.01),
        fitted(TELESCOPE, binary(flux=1e12), Linear.of(0.6, 25.0), by="linear"),
        fitted(TELESCOPE, binary(flux=1e12), readout=True),
    ]


@row("read noise far above the signal", "no star; just above it: the truth within its error, or a status")
def noisy():
    def frame(noise, ends):
        loud = telescope(read_noise=noise, bias=100 * noise)
        return fitted(loud, binary(), readout=True, ends=ends)

    return [frame(1e5, ("NO_STAR",)), frame(3e3, UNRESOLVED)]


@row("contrast 1", "the stars swap: the pair turned by 180° is the same image; the truth")
def equal_stars():
    one, other = (image_of(binary(contrast=1.0, theta=angle), Stable.of(), OTF) for angle in (33.0, 213.0))
    return [
        near("swapped", other, one, ROUNDING),
        finite(binary(contrast=1.0), Shm.of(0.6, 25.0), OTF),
        fitted(TELESCOPE, binary(contrast=1.0)),
    ]


@row("contrast 1e6", "the sum of two single stars; only one is seen")
def faint_star():
    scene = binary(contrast=1e6)
    x, y, _ = (np.asarray(part) for part in scene.sources())
    light = 1e6 * np.array([1e6, 1.0]) / (1e6 + 1)
    stars = [image_of(Star(*star), Stable.of(), OTF) for star in zip(x, y, light, strict=True)]
    pair = image_of(scene, Stable.of(), OTF)
    return [
        near("against two stars", pair, sum(stars), ROUNDING),
        near("what B adds", pair - stars[0], stars[1], 1e-6),
        finite(scene, Linear.of(0.6, 25.0), OTF),
        fitted(TELESCOPE, scene, ends=("NO_PAIR",)),
    ]


@row("separation 0", "one star of the whole flux; only one is seen")
def together():
    scene = binary(separation=0.0)
    return [
        near(
            "against a star",
            image_of(scene, Stable.of(), OTF),
            image_of(Star(0.4, -0.6, 1e6), Stable.of(), OTF),
            ROUNDING,
        ),
        finite(scene, Linear.of(0.6, 25.0), OTF),
        fitted(TELESCOPE, scene, ends=("NO_PAIR",)),
    ]


@row("separation 0.1 λ/D", "a status: not resolved")
def close():
    scene = binary(separation=0.1 * 585e-9 / 0.125 * 206265)
    return [finite(scene, Linear.of(0.6, 25.0), OTF), fitted(TELESCOPE, scene, ends=UNRESOLVED)]


@row("separation outside the frame", "Fraunhofer's integral; a status; a refusal")
def far_apart():
    scene, fine = binary(separation=30.0), telescope(samples=256)
    found = image_of(scene, Stable.of(), fine.optics(STATE, pad=192))
    return [
        near("against the integral", found, direct(fine, STATE, scene), 1e-5),
        finite(scene, Linear.of(0.6, 25.0), OTF),
        fitted(TELESCOPE, scene, ends=UNRESOLVED),
        refused(
            lambda: simulate_frame(TELESCOPE, binary(separation=500.0), Stable.of()), "leaves the modelled"
        ),
    ]
