"""What an estimate leaves on disk beside its row: a picture, a kernel file, the image without its blur."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.batch.measured import Measured
from jitterkit.errors import ConfigurationError, FrameError
from jitterkit.frames import write_fits
from jitterkit.frames.whole import replacing
from jitterkit.kernels import deblur, kernel_image, write_kernel
from jitterkit.report.plots import png

__all__ = ["Products"]

_ENDS = (".png", ".kernel.fits", ".deblurred.fits")
"""Of the pictures', kernels' and images' names."""


@dataclass(frozen=True)
class Products:
    """Writes what was asked for, a file a frame, named after the frame.

    Attributes
    ----------
    pictures, kernels, images : Path, optional
        Directories for pictures (PNG), kernels (FITS) and deblurred images (FITS).
    overwrite : bool
        Whether files of earlier runs may be replaced.

    Raises
    ------
    ConfigurationError
        If a directory cannot be made, or holds products already and they may not be replaced: told
        before any work is done.
    """

    pictures: Path | None = None
    kernels: Path | None = None
    images: Path | None = None
    overwrite: bool = False
    _written: set[str] = field(default_factory=set, repr=False)

    def __post_init__(self) -> None:
        for directory, end in zip((self.pictures, self.kernels, self.images), _ENDS, strict=True):
            if directory is None:
                continue
            present = sorted(directory.glob(f"*{end}"))
            if present and not self.overwrite:
                raise ConfigurationError(
                    f"{present[0]} exists; give --overwrite to replace it, or another directory."
                )
            try:
                directory.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ConfigurationError(
                    f"{directory} cannot be made ({error.strerror}); give a directory that can be written."
                ) from None

    def write(self, measured: Measured) -> None:
        """Write the files of one frame.

        Raises
        ------
        FrameError
            If a file cannot be written, or is that of another frame of this run.
        UndeterminedError
            If there is no blur to draw.
        """
        stem = _stem(measured)
        if stem in self._written:
            raise FrameError(
                measured.frame.name,
                f"would replace the products of another frame of the name {stem}",
                "process its directory on its own",
            )
        self._written.add(stem)
        if self.pictures is not None:
            picture = png(measured.draw()[0])
            with replacing(self.pictures / f"{stem}{_ENDS[0]}", overwrite=True) as temporary:
                temporary.write_bytes(picture)
        if self.kernels is None and self.images is None:
            return
        kernel = kernel_image(measured.estimate, measured.plate_scale or 1.0)
        if self.kernels is not None:
            _write_kernel(self.kernels / f"{stem}{_ENDS[1]}", kernel, measured)
        if self.images is not None:
            _write_deblurred(self.images / f"{stem}{_ENDS[2]}", kernel, measured)


def _write_kernel(path: Path, kernel: np.ndarray, measured: Measured) -> None:
    scale = measured.plate_scale
    if scale is None:  # nothing to say in arcsec
        write_fits(path, kernel, header={"JITRTYPE": ("Custom jitter kernel", "on pixels")}, overwrite=True)
    else:
        write_kernel(path, kernel, plate_scale=scale, estimate=measured.estimate, overwrite=True)


def _write_deblurred(path: Path, kernel: np.ndarray, measured: Measured) -> None:
    frame, scale = measured.frame, measured.plate_scale
    known = "gain_assumed" not in frame.flags  # else the noise is taken from the image itself
    sharp = deblur(frame.electrons, kernel, variance=frame.variance if known else None, mask=frame.mask)
    cards: dict[str, tuple[Any, str]] = {
        "SOURCE": (frame.name, "frame that was deblurred"),
        "METHOD": (measured.estimate.method, "estimator of the kernel"),
        "DEBLUR": ("richardson-lucy", "to look at, not to measure"),
    }
    if scale is not None:
        cards["PIXSCALE"] = (scale, "[arcsec/pixel]")
    write_fits(path, sharp.astype(np.float32), header=cards, overwrite=True)


def _stem(measured: Measured) -> str:
    """``cube_3`` for the fourth frame of ``cube.fits``."""
    frame = measured.frame
    name = "array" if frame.path is None else frame.path.name
    for end in (".gz", ".fz"):
        name = name.removesuffix(end)
    stem = Path(name).stem
    return f"{stem}_{frame.index}" if frame.several else stem
