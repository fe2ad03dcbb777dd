"""Make the inputs of ``scripts/compare_versions`` from fixed seeds, and their digests.

The night comes from ``make_night``; star fields and motions from numpy alone, so that no version of jitterkit
changes them.  :func:`make_inputs` writes all inputs; :func:`digests` shows if those of two runs are equal.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Container
from pathlib import Path

import numpy as np
from astropy.io import fits
from compare_tasks import Sizes

SAMPLES = Path(__file__).resolve().parent.parent / "sample_frames"
SETS = ("sample", "night", "stars", "motion")
FRAMES = (".fits", ".gz", ".fz", ".tif", ".toml")

SEED = 2040
"""Seed of the star fields."""

FWHM, BETA, HALF = 3.0, 3, 20
"""Width of an untrailed star in pixels, Moffat's exponent, and half the side of a star's stamp in pixels."""

TRAILS = ((2.0, 30.0), (4.0, 100.0), (1.0, 165.0), (6.0, 60.0))
"""Pixels, deg: length and angle of the trail in each star field."""


def make_inputs(
    root: Path, sizes: Sizes, make_night: Callable[[Path, int], None], wanted: Container[str] = SETS
) -> None:
    """Write the inputs.

    Parameters
    ----------
    root : Path
        Directory of the inputs; deleted and written again.
    sizes : Sizes
    make_night : callable
        Function that writes a number of frames into a directory.
    wanted : container of str
        Names of the sets to make.
    """
    shutil.rmtree(root, ignore_errors=True)
    makers = {
        "sample": lambda directory: copy_samples(directory, sizes),
        "night": lambda directory: write_night(directory, sizes, make_night),
        "stars": lambda directory: write_fields(directory, sizes),
        "motion": write_motions,
    }
    for name, make in makers.items():
        (root / name).mkdir(parents=True)
        if name in wanted:
            make(root / name)


def copy_samples(directory: Path, sizes: Sizes) -> None:
    """Copy the sample frames."""
    for path in sorted(SAMPLES.iterdir()):
        wanted = path.name in sizes.samples if sizes.samples else path.suffix in FRAMES
        if path.is_file() and wanted:
            shutil.copy(path, directory)


def write_night(directory: Path, sizes: Sizes, make_night: Callable[[Path, int], None]) -> None:
    """Write a simulated night, and next to it copies of its first frames for two of the tasks."""
    make_night(directory, sizes.night)
    for name, frames in (("part", sizes.part), ("sequence", sizes.sequence)):
        copies = directory.with_name(f"night_{name}")
        copies.mkdir()
        for path in sorted(directory.glob("*.fits"))[:frames]:
            shutil.copy(path, copies)


def write_fields(directory: Path, sizes: Sizes) -> None:
    """Write a sharp star field and trailed ones, in electrons."""
    rng = np.random.default_rng(SEED)
    (directory / "trailed").mkdir()
    _write_fits(directory / "sharp.fits", draw_field(rng, sizes.stars, sizes.side, 0.0, 0.0))
    for number, (length, angle) in enumerate(TRAILS[: sizes.fields]):
        image = draw_field(rng, sizes.stars, sizes.side, length, angle)
        _write_fits(directory / "trailed" / f"{number}.fits", image)


def _write_fits(path: Path, image: np.ndarray) -> None:
    fits.PrimaryHDU(image.astype(np.float32)).writeto(path)


def draw_field(rng: np.random.Generator, stars: int, side: int, length: float, angle: float) -> np.ndarray:
    """Draw isolated Moffat stars of 3e3 to 3e5 electrons, all trailed alike, with sky, photon and read noise.

    The expected image is rounded before the noise is drawn, so that the last digit of a cosine does not
    change a draw.
    """
    image, positions = np.full((side, side), 100.0), np.zeros((0, 2))
    while len(positions) < stars:
        position = rng.uniform(HALF, side - HALF - 1, 2)
        if np.all(np.hypot(*(positions - position).T) > 30):
            positions = np.vstack([positions, position])
    for position in positions:
        ix, iy = np.rint(position).astype(int)
        star = draw_star(*(position - (ix, iy)), length, angle)
        image[iy - HALF : iy + HALF + 1, ix - HALF : ix + HALF + 1] += 3e3 * 100 ** rng.uniform() * star
    return rng.poisson(image.round(6)) + rng.normal(0, 5, image.shape).round(3)


def draw_star(dx: float, dy: float, length: float, angle: float) -> np.ndarray:
    """Integrate a Moffat star of unit flux along a line and over pixels, by 3 x 3 Gauss nodes in each."""
    square_width = FWHM**2 / (4 * (2 ** (1 / BETA) - 1))
    nodes, shares = np.polynomial.legendre.leggauss(3)
    steps, weights = np.polynomial.legendre.leggauss(4 + int(3 * length))
    grid = np.arange(-HALF, HALF + 1)
    fine, share = (grid[:, None] + nodes / 2).ravel(), np.tile(shares / 2, len(grid))
    density = np.zeros((len(fine), len(fine)))
    for step, weight in zip(steps * length / 2, weights / 2, strict=True):
        px, py = dx + step * np.cos(np.radians(angle)), dy + step * np.sin(np.radians(angle))
        radius = np.square(fine - px) + np.square(fine - py)[:, None]
        density += weight * (BETA - 1) / (np.pi * square_width) * (1 + radius / square_width) ** -BETA
    return (density * share * share[:, None]).reshape(len(grid), 3, len(grid), 3).sum((1, 3))


def write_motions(directory: Path) -> None:
    """Write a pointing trace, a spectrum of motion and the vibrations of the sample frames."""
    shutil.copy(SAMPLES / "motion" / "hst.csv", directory / "lines.csv")
    t = np.arange(2000) / 2000
    x = 0.05 * np.sin(2 * np.pi * 3 * t) + 0.02 * np.sin(2 * np.pi * 47 * t + 1)
    y = 0.03 * np.cos(2 * np.pi * 5 * t) + 0.04 * t + 0.01 * np.sin(2 * np.pi * 47 * t)
    f = np.geomspace(0.1, 400, 60)
    sxx, syy = 2e-4 / (1 + (f / 2) ** 2), 1e-4 / (1 + (f / 5) ** 2)
    _write_csv(directory / "trace.csv", "t,x,y", (t, x, y), "%.9f")
    _write_csv(directory / "spectrum.csv", "f,x,y", (f, sxx, syy), "%.9g")


def _write_csv(path: Path, header: str, columns: tuple[np.ndarray, ...], form: str) -> None:
    np.savetxt(path, np.column_stack(columns), fmt=form, delimiter=",", header=header, comments="")


def digests(root: Path) -> dict[str, str]:
    """Return the SHA-256 of each set: file names with the pixels of FITS files or the bytes of others."""
    found = {}
    for name in SETS:
        digest = hashlib.sha256()
        for path in sorted(path for path in (root / name).rglob("*") if path.is_file()):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(_content(path))
        found[name] = digest.hexdigest()
    return found


def _content(path: Path) -> bytes:
    if not {".fits", ".fz"} & set(path.suffixes):
        return path.read_bytes()
    with fits.open(path) as file:
        image = next(hdu.data for hdu in file if hdu.data is not None)
        return str(image.shape).encode() + np.ascontiguousarray(image, "<f8").tobytes()
