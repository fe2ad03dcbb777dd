"""What an estimate leaves on disk beside its row: a picture, a kernel file, the image without its blur."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from astropy.wcs import Sip

from jitterkit.batch.records import BlurMeasurement, SceneEstimate
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.forward import expected_image
from jitterkit.frames import Frame, write_fits
from jitterkit.frames.sky import turned_over
from jitterkit.frames.writer import replacing
from jitterkit.kernels import deblur, in_rows, kernel_image, write_kernel
from jitterkit.likelihood import pearson
from jitterkit.loci import Stable
from jitterkit.report.estimate_pictures import plot_estimate, plot_extended, plot_field
from jitterkit.report.outputs import ENDS, make_directory
from jitterkit.report.plots import png
from jitterkit.starfield import FieldEstimate


@dataclass(frozen=True)
class Products:
    """Writes what was asked for, a file a frame, named after the frame: ``shm.png``.

    Of a second frame of that name it is the full one of the file: ``shm.tif.png``.

    Attributes
    ----------
    pictures, kernels, images : Path, optional
        Directories for pictures (PNG), kernels (FITS) and deblurred images (FITS).
    overwrite : bool
        Whether files of earlier runs may be replaced.
    oversample : int
        Pixels of a kernel per detector pixel along each axis, as the tool that is to use it oversamples.
    file_rows : bool
        Whether kernels and images of a frame whose file begins with the top row (a TIFF) begin with it too,
        as tools need that convolve the file's own array; by default their first row is the lowest.

    Raises
    ------
    ConfigurationError
        If a directory cannot be written, or holds products already and they may not be replaced; raised
        before any work is done.
    """

    pictures: Path | None = None
    kernels: Path | None = None
    images: Path | None = None
    overwrite: bool = False
    oversample: int = 1
    file_rows: bool = False
    _written: set[str] = field(default_factory=set, repr=False)
    _files: set[str] = field(default_factory=set, repr=False)

    def __post_init__(self) -> None:
        for directory, end in zip((self.pictures, self.kernels, self.images), ENDS, strict=True):
            if directory is not None:
                make_directory(directory, [f"*{end}"], self.overwrite)

    def write(self, measured: BlurMeasurement) -> None:
        """Write the files of one frame.

        Raises
        ------
        FrameError
            If a file cannot be written, or is that of another frame of this run, of another directory.
        UndeterminedError
            If there is no blur to draw.
        """
        if self.pictures is self.kernels is self.images is None:
            return  # then no name can be taken
        stem = self._name(measured)
        if self.pictures is not None:
            picture = png(_draw(measured)[0])
            with replacing(self.pictures / f"{stem}{ENDS[0]}", overwrite=True) as temporary:
                temporary.write_bytes(picture)
        if self.images is not None:
            _write_deblurred(self.images / f"{stem}{ENDS[2]}", measured, self.file_rows)
        if self.kernels is not None:
            _write_kernel(self.kernels / f"{stem}{ENDS[1]}", measured, self.oversample, self.file_rows)

    def _name(self, measured: BlurMeasurement) -> str:
        """Return the file name of a frame's products, without the suffix; each is given once."""
        stem, full = _names(measured)
        if full in self._files or {stem, full} <= self._written:
            problem = f"would replace the products of another frame of the name {stem}"
            remedy = "process its directory on its own"
            raise FrameError(ErrorCode.EXISTS, measured.frame.name, problem, remedy)
        name = full if stem in self._written else stem
        self._files.add(full)
        self._written.add(name)
        return name


def _draw(measured: BlurMeasurement) -> list[Any]:
    """Return the three axes of the picture of a measurement."""
    estimate, scale, evidence = measured.estimate, measured.plate_scale, measured.evidence
    if isinstance(evidence, SceneEstimate):
        assert scale is not None  # the instrument has one
        data, image, blurred = evidence.data, measured.frame.electrons, evidence.blurred()
        sharp = np.asarray(expected_image(evidence.parameters.with_locus(Stable.of()), evidence.otf))
        variance = np.asarray((blurred.clip(0) + data.offset) / data.weight)
        mask = ~np.isfinite(pearson(blurred, data).residual)
        return plot_estimate(estimate, image, sharp, blurred, scale, variance=variance, mask=mask)
    if isinstance(evidence, FieldEstimate):
        x, y, moments = (values[evidence.used] for values in (evidence.x, evidence.y, evidence.moments))
        where = x, y, moments, evidence.common, measured.frame.shape
        return plot_field(estimate, *where, plate_scale=scale)
    sharp = deblur(evidence, kernel_image(estimate, scale or 1.0))
    return plot_extended(estimate, evidence, sharp, plate_scale=scale)


def _write_kernel(path: Path, measured: BlurMeasurement, oversample: int, file_rows: bool) -> None:
    estimate, scale = measured.estimate, measured.plate_scale
    kernel, rows = kernel_image(estimate, scale or 1.0, oversample), _rows(measured.frame, file_rows)
    remark = "undetected: no jitter at all may give such a kernel" if estimate.is_undetected else ""
    if scale is None:  # nothing to say in arcsec
        kind = "Blur that is not known to be jitter" if estimate.undetermined else "Custom jitter kernel"
        array, cards = in_rows(kernel, rows)
        cards["JITRTYPE"] = (kind, "on pixels")
        cards["OVERSAMP"] = (oversample, "kernel pixels per detector pixel")
        remarks = "\n".join(filter(None, (estimate.undetermined, remark)))
        cards |= {"COMMENT": (remarks, "")} if remarks else {}
        write_fits(path, array, header=cards, overwrite=True)
    else:
        written: Any = {"estimate": estimate, "oversample": oversample, "remark": remark, "rows": rows}
        write_kernel(path, kernel, plate_scale=scale, **written, overwrite=True)


def _write_deblurred(path: Path, measured: BlurMeasurement, file_rows: bool) -> None:
    frame, scale = measured.frame, measured.plate_scale
    kernel = kernel_image(measured.estimate, scale or 1.0)
    known = "gain_assumed" not in frame.flags  # else the noise is taken from the image itself
    sharp = deblur(frame.electrons, kernel, variance=frame.variance if known else None, mask=frame.mask)
    array, cards = in_rows(sharp.astype(np.float32), _rows(frame, file_rows))
    cards |= {
        "SOURCE": (frame.name, "frame that was deblurred"),
        "METHOD": (measured.estimate.method, "estimator of the kernel"),
        "DEBLUR": ("richardson-lucy", "to look at, not to measure"),
    }
    is_charge = not str(frame.metadata.gain and frame.metadata.gain.source).startswith("assumed")
    is_charge = is_charge or frame.metadata.value("unit") == "electron"
    cards["BUNIT"] = ("electron" if is_charge else "adu", "unit of the pixels")
    cards |= _coordinates(frame, file_rows)
    if scale is not None:
        cards["PIXSCALE"] = (scale, "[arcsec/pixel]")
    if measured.estimate.undetermined:
        cards["COMMENT"] = (measured.estimate.undetermined, "")
    write_fits(path, array, header=cards, overwrite=True)


def _coordinates(frame: Frame, file_rows: bool) -> dict[str, Any]:
    """Return the cards of the WCS of an export, for its part of the frame and its order of rows."""
    wcs, (x0, y0) = frame.metadata.wcs, frame.origin
    if wcs is None:
        return {}
    wcs = wcs.deepcopy()
    wcs.wcs.crpix = wcs.wcs.crpix - np.array([x0, y0])
    if wcs.sip is not None:
        wcs.sip = Sip(wcs.sip.a, wcs.sip.b, wcs.sip.ap, wcs.sip.bp, wcs.sip.crpix - np.array([x0, y0]))
    if _rows(frame, file_rows) == "TOP-DOWN" and (wcs := turned_over(wcs, frame.shape[0])) is None:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of lookup tables, which do not fit into a header
        header = wcs.to_header(relax=True)
    return {card.keyword: (card.value, card.comment) for card in header.cards}


def _rows(frame: Frame, file_rows: bool) -> str:
    """Order of the rows of a frame's exports; nothing where the frame's own file has its lowest row first."""
    if frame.metadata.row_order != -1:
        return ""
    return "TOP-DOWN" if file_rows else "BOTTOM-UP"


def _names(measured: BlurMeasurement) -> tuple[str, str]:
    """Return ``cube_3`` and ``cube.fits_3`` for the fourth frame of ``cube.fits``."""
    frame = measured.frame
    full = name = "array" if frame.path is None else frame.path.name
    for end in (".gz", ".fz"):
        name = name.removesuffix(end)
    end = f"_{frame.index}" if frame.several else ""
    return Path(name).stem + end, full + end
