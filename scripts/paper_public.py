"""The public package beside jitterkit: its Hessian timed, and the axes of its jitter layers."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from paper_study import PLATE_SCALE, Part, Study

from jitterkit.forecast import forecast
from jitterkit.kernels import kernel_moments
from jitterkit.loci import Linear, axis_variances
from jitterkit.report.words import number

LENGTH, ANGLE = 0.375, 30.0
"""arcsec and degrees."""

CELL, CELLS = PLATE_SCALE / 4, 41
"""arcsec, and how many along a side of a kernel: enough for the largest jitter here."""

SIGMA, SHEAR, AMPLITUDE = 0.3, 0.5, 0.6
"""arcsec, of the layers' normal and vibration: eight cells, so that the raster hardly counts."""


def hessian(study: Study) -> Part:
    """One point of the paper's sweep by the public model's Hessian, in a process of its own."""
    part = Part()
    parameters = study.parameters(Linear.of(LENGTH, ANGLE))
    forecast(parameters, study.exact.nominal)  # compiles
    began = time.perf_counter()
    forecast(parameters, study.exact.nominal)
    part.timings.append(("one point of a sweep, jitterkit, five lines", time.perf_counter() - began))
    if study.skip_public:
        return part
    benchmark = str(Path(__file__).with_name("benchmark"))
    settings = ["--measure", "public fisher", "--length", str(LENGTH), "--repeats", "1"]
    done = subprocess.run(
        [sys.executable, benchmark, *settings], check=True, stdout=subprocess.PIPE, text=True
    )
    found = json.loads(done.stdout.splitlines()[-1])
    memory = f"three lines, {found['peak_mb'] / 1024:.1f} GB"
    part.timings.append((f"one point of a sweep, dLuxToliman's Hessian, {memory}", found["warm"]))
    return part


def layers(study: Study) -> Part:
    """Which way the public package's jitter layers turn, and how wide they are."""
    part = Part()
    try:
        from dLuxToliman import GaussianJitter, SHMJitter
    except ImportError:
        return part
    normal, across, axis = _axes(GaussianJitter((SIGMA**2 * (1 - SHEAR)) ** 2, SHEAR, ANGLE, CELLS))
    _, _, harmonic = _axes(SHMJitter(AMPLITUDE, ANGLE, CELLS))
    harmonic -= 180 if harmonic > 90 else 0
    for name, found in (("normal", axis), ("harmonic", harmonic)):
        part.add(f"axis of dLuxToliman's {name} layer asked for {ANGLE:g}°", "°", "code", found, ANGLE)
    ratio = float(np.sqrt(across / normal))
    part.add(f"σ_min/σ_maj of dLuxToliman's normal layer, η {SHEAR:g}", "", "code", ratio, 1 - SHEAR,
             remark="of the version that is installed")  # fmt: skip
    asked = AMPLITUDE**2 / 2
    widths = [
        100 * (_axes(SHMJitter(AMPLITUDE, angle, CELLS))[0] / asked - 1) for angle in (0.0, ANGLE, 45.0)
    ]
    part.slips[8] = (
        f"In the public package two layers turn one angle in opposite directions: asked for {ANGLE:g}°, the "
        f"normal's axis lies at {axis:.0f}° and the vibration's at {number(harmonic, 2)}°. The latter's "
        f"variance also changes with the angle: {', '.join(number(w, 2) for w in widths)} % off at 0°, "
        f"{ANGLE:g}° and 45°. Tests of second moments catch both."
    )
    return part


def _axes(layer) -> tuple[float, float, float]:
    """Variances along and across a layer's axis [arcsec²], and its angle [deg]."""
    return axis_variances(kernel_moments(np.asarray(layer.generate_kernel(CELL)), CELL))
