"""Rows of ``scripts/extremes``: jitter from none to more than the frame."""

from __future__ import annotations

import numpy as np
from extremes_checks import SCALE, STATE, Check, binary, finite, fitted, image_of, near, refused, worst
from extremes_references import along, motion, normal, shifted
from extremes_table import OTF, ROUNDING, STILL, TELESCOPE, row

from jitterkit.loci import Ellipse, Linear, Mvn, PartialShm, Path, Shaped, Shm
from jitterkit.simulate import simulate_frame


def small(size: float) -> list[Check]:
    """Loci of next to no size: as if there were none."""
    loci = [
        Linear.of(size, 25.0),
        Shm.of(size, 25.0),
        Mvn.of(size, size / 2, 25.0),
        Ellipse.of(size, size / 2),
        PartialShm.of(size, 25.0, 0.7, 30.0),
        Shaped.of(size, size / 2, 25.0, -1.2),
    ]
    return [
        worst(near(type(a).__name__, image_of(binary(), a, OTF), STILL, ROUNDING) for a in loci),
        worst(finite(binary(), locus, OTF) for locus in loci),
        fitted(TELESCOPE, binary(), loci[0], by="linear"),
    ]


@row("jitter 0", "the image without jitter, to rounding; the truth")
def no_jitter():
    return small(0.0)


@row("jitter 1e-12″", "the same: the change is 2π²f²σ², 1e-23")
def hardly_any_jitter():
    return small(1e-12)


@row("jitter of one pixel", "the sum of shifted images; the truth")
def one_pixel():
    locus = Linear.of(SCALE, 25.0)
    return [
        near(
            "against 12 images",
            image_of(binary(), locus, OTF),
            shifted(binary(), OTF, *along(SCALE, 25, 12)),
            ROUNDING,
        ),
        finite(binary(), locus, OTF),
        fitted(TELESCOPE, binary(), locus, by="auto"),
    ]


@row("jitter of ten pixels", "the sum of shifted images; the truth")
def ten_pixels():
    length = 10 * SCALE
    locus, curved = Linear.of(length, 25.0), PartialShm.of(length, 25.0, 0.6, 30.0)
    path = motion(25.0, lambda t: length / 2 * np.sin(2 * np.pi * 0.6 * t + np.radians(30.0)))
    return [
        near(
            "drift", image_of(binary(), locus, OTF), shifted(binary(), OTF, *along(length, 25, 40)), ROUNDING
        ),
        near("part of a cycle", image_of(binary(), curved, OTF), shifted(binary(), OTF, *path), 1e-9),
        finite(binary(), locus, OTF),
        fitted(TELESCOPE, binary(), locus, by="linear"),
    ]


@row("the same, of loci without a formula", "refused where their quadrature or series ends")
def beyond_the_nodes():
    positions = np.array([[-8.0, 0.0], [0.0, 3.0], [8.0, 0.0]])
    loci = [PartialShm.of(3.75, 25.0, 3.0), Path.of(positions), Shaped.of(1.5, 0.0, 25.0, -1.2)]
    return [
        refused(lambda a=locus: simulate_frame(TELESCOPE, binary(), a), "take a smaller one")
        for locus in loci
    ]


@row("jitter larger than the frame", "the sum of shifted images, or a refusal")
def larger_than_the_frame():
    length, otf = 24.0, TELESCOPE.optics(STATE, pad=96)
    found = [image_of(binary(), kind.of(length, 25.0), otf) for kind in (Linear, Shm)]
    turn = motion(25.0, lambda t: length / 2 * np.sin(2 * np.pi * t))
    return [
        near("drift of 24″ over 18″", found[0], shifted(binary(), otf, *along(length, 25, 160)), ROUNDING),
        near("vibration", found[1], shifted(binary(), otf, *turn), ROUNDING),
        finite(binary(), Linear.of(length, 25.0), otf),
        fitted(TELESCOPE, binary(), Linear.of(length, 25.0), by="linear", ends=("POOR_FIT", "NO_PAIR")),
        refused(lambda: simulate_frame(TELESCOPE, binary(), Linear.of(100.0)), "leaves the modelled field"),
    ]


def sheared(shear: float) -> list[Check]:
    locus = Mvn.sheared(0.3, shear, 25.0)
    summed = shifted(binary(), OTF, *normal(0.3, 0.3 * (1 - shear), 25.0))
    return [
        near("against 400 images", image_of(binary(), locus, OTF), summed, ROUNDING),
        finite(binary(), locus, OTF),
        fitted(TELESCOPE, binary(), locus),
    ]


@row("shear 0", "a round normal; the truth")
def round_blur():
    return sheared(0.0)


@row("shear 1 - 1e-9", "a line of images, normally weighted; the truth")
def line_blur():
    return sheared(1 - 1e-9)


@row("SHM at its end points", "of cycles 0.05 and 3, of phase 90°; of ellipse and shaped: a vibration")
def end_points():
    checks = []
    for cycles, phase in ((0.05, 0.0), (0.05, 90.0), (3.0, 0.0), (3.0, 90.0)):
        locus = PartialShm.of(0.6, 25.0, cycles, phase)
        swing = motion(25.0, lambda t, a=cycles, p=phase: 0.3 * np.sin(2 * np.pi * a * t + np.radians(p)))
        found = image_of(binary(), locus, OTF)
        checks.append(near(f"{cycles:g} cycles at {phase:g}°", found, shifted(binary(), OTF, *swing), 1e-10))
        checks.append(finite(binary(), locus, OTF))
    shm = image_of(binary(), Shm.of(0.6, 25.0), OTF)
    flat, ring = Ellipse.of(0.3, 0.0, 25.0), Shaped.of(0.3 / np.sqrt(2), 0.0, 25.0, -1.5)
    return [
        *checks[0:8:2],
        worst(checks[1:8:2]),
        near("flat ellipse", image_of(binary(), flat, OTF), shm, ROUNDING),
        near("kurtosis -1.5", image_of(binary(), ring, OTF), shm, ROUNDING),
        fitted(TELESCOPE, binary(), PartialShm.of(0.6, 25.0, 0.5, 90.0), by="partial"),
    ]
