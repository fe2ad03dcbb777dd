"""Rows of ``scripts/extremes``: 32 bits, hardly any pixels, and starts from far away."""

from __future__ import annotations

import jax
import numpy as np
from extremes_checks import STATE, Check, binary, finite, fitted, image_of, near, recovered, telescope, worst
from extremes_table import OTF, STILL, TELESCOPE, UNRESOLVED, row

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, PartialShm, Shaped, Shm
from jitterkit.refit import fit_frame
from jitterkit.simulate import simulate_frame


def images(otf) -> np.ndarray:
    """Of loci that lose digits in different ways, at a mild contrast and an extreme one."""
    loci = [Linear.of(0.6, 25.0), Shm.of(3.75, 25.0), Mvn.of(0.3, 0.1), PartialShm.of(0.6, 25.0, 0.5, 90.0)]
    loci += [Shaped.of(0.3, 0.1, 25.0, -1.2)]
    return np.array([image_of(binary(contrast=c), locus, otf) for locus in loci for c in (3.37, 1e6)])


@row("float32 throughout", "the image in 64 bits to 3e-5; the truth")
def single_precision():
    double = images(OTF)
    jax.clear_caches()  # programs of the one precision do not take the other's numbers
    with jax.enable_x64(False):
        otf = TELESCOPE.optics(STATE)
        single = images(otf)
        assert single.dtype == np.float32
        checks = [
            near("image", single, double, 3e-5),
            finite(binary(), Linear.of(0.6, 25.0), otf),
            finite(binary(contrast=1e6), Shaped.of(0.3, 0.1, 25.0, -1.2), otf),
            fitted(TELESCOPE, binary(), Linear.of(0.6, 25.0), by="linear"),
            fitted(TELESCOPE, binary(flux=1e12), ends=UNRESOLVED),
        ]
    jax.clear_caches()
    return [checks[0], worst(checks[1:3]), *checks[3:]]


@row("all pixels but ten masked", "a status that says so")
def ten_pixels_left():
    order, plain = np.argsort(STILL.ravel())[::-1], telescope(noll=())

    def left(count: int, seed: int, pool: int, **options) -> Check:
        """A frame of which only some of the brightest pixels may be used."""
        kept = np.random.default_rng(seed).permutation(order[:pool])[:count]
        mask = np.isin(np.arange(STILL.size), kept, invert=True).reshape(STILL.shape)
        return fitted(plain, binary(), by="stable", mask=mask, seed=seed, **options)

    return [
        worst(left(10, seed, pool, ends=("NO_DATA",)) for pool in (10, 200) for seed in range(3)),
        worst(left(64, seed, pool) for pool in (64, 200) for seed in range(3)),
    ]


@row("a million sigma from the start", "finite; the truth or a status")
def far_start():
    system = TELESCOPE.system()
    frame = simulate_frame(
        TELESCOPE, binary(), Mvn.of(0.3, 0.1), rng=np.random.default_rng(1), detector=False
    )
    data = Data(np.asarray(frame.raw.data))
    best = fit_frame(data, system, Parameters(binary(), Mvn.of(0.3, 0.1), np.zeros(2)))
    checks = [recovered(best, 4.0)]
    for name in ("separation", "theta", "x", "flux", "contrast"):
        value = best.of_scene(name) + 1e6 * best.error(name)
        scene = binary(**{name: value})
        checks.append(finite(scene, Mvn.of(0.3, 0.1), system.nominal))
        result = fit_frame(data, system, Parameters(scene, Mvn.of(0.3, 0.1), np.zeros(2)))
        found = recovered(result, 4.0)
        said = found if result.status.usable else Check(found.came, bool(result.message))
        checks.append(Check(f"{name} {value:.3g}: {said.came}", said.good))
    return [checks[0], worst(checks[1::2]), *checks[2::2]]
