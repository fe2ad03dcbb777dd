"""``jitterkit photons``: how many photons an exposure of the pair detects."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.products import check_products, write_picture
from jitterkit.cli.runtime import command_line, prepare_jax, say

if TYPE_CHECKING:
    from jitterkit.instruments import Instrument
    from jitterkit.photons import Curve, Line, Throughput

__all__ = ["photons"]

_CSV = "FILE.csv"


def photons(
    instrument: options.InstrumentName = "toliman",
    spectrum_a: Annotated[
        Path | None,
        typer.Option(
            metavar=_CSV,
            help="Spectrum of A: wavelength_nm, photons per nm in any unit; it is scaled to V. A blackbody "
            "without.",
            show_default=False,
        ),
    ] = None,
    spectrum_b: Annotated[
        Path | None, typer.Option(metavar=_CSV, help="Spectrum of B, likewise.", show_default=False)
    ] = None,
    temperatures: Annotated[
        tuple[float, float], typer.Option(metavar="A B", help="Of the blackbodies, K.")
    ] = (5790.0, 5260.0),
    magnitudes: Annotated[tuple[float, float], typer.Option(metavar="A B", help="V of the stars.")] = (
        0.01,
        1.33,
    ),
    filter_file: Annotated[
        Path | None,
        typer.Option(
            "--filter",
            metavar=_CSV,
            help="Transmission of the filter: wavelength_nm, value from 0 to 1. The instrument's band, "
            "without loss, if omitted.",
            show_default=False,
        ),
    ] = None,
    glass: Annotated[float, typer.Option(help="Transmission of a glass plate.")] = 0.91,
    plates: Annotated[int, typer.Option(min=0, help="How many plates.")] = 2,
    qe: Annotated[
        Path | None,
        typer.Option(
            metavar=_CSV,
            help="Quantum efficiency: wavelength_nm, value from 0 to 1. An IMX183's, nominal, if omitted.",
            show_default=False,
        ),
    ] = None,
    exposure: options.Exposure = None,
    area: Annotated[
        float | None,
        typer.Option(help="Collecting area, cm2; of the instrument's pupil if omitted.", show_default=False),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw spectra and throughput.", show_default=False),
    ] = None,
    output: options.TableOutput = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Count the photons of alpha Cen AB in an exposure, beside the paper's."""
    check_products(plot, output, overwrite)
    prepare_jax()
    from jitterkit.instruments import load_instrument
    from jitterkit.photons import compare, count_photons

    telescope = load_instrument(instrument)
    stars = (
        _star(spectrum_a, temperatures[0], magnitudes[0]),
        _star(spectrum_b, temperatures[1], magnitudes[1]),
    )
    budget = count_photons(
        stars,
        _throughput(telescope, filter_file, glass, plates, qe),
        area=_area(telescope) if area is None else area,
        exposure=_exposure(telescope) if exposure is None else exposure,
    )
    lines = compare(budget, published=telescope.name.startswith("toliman"))
    typer.echo("\n".join(_rows(lines)))
    if output is not None:
        _write(output, lines, overwrite)
    if plot is not None:
        from jitterkit.report.photon_plots import plot_photons

        write_picture(plot, plot_photons(budget)[0], overwrite)


def _star(path: Path | None, temperature: float, magnitude: float) -> Curve:
    from jitterkit.errors import ConfigurationError
    from jitterkit.photons import blackbody, read_curve, tabulated

    if path is None:
        return blackbody(temperature, magnitude)
    try:
        return tabulated(read_curve(path), magnitude)
    except ConfigurationError as error:
        message = str(error)
        raise ConfigurationError(
            error.code, message if str(path) in message else f"{path}: {message}"
        ) from None


def _throughput(
    telescope: Instrument, filter_file: Path | None, glass: float, plates: int, qe: Path | None
) -> Throughput:
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.photons import IMX183_QE, Throughput, band_of, read_curve

    if filter_file is not None:
        passed = read_curve(filter_file)
    elif telescope.spectrum is not None:
        passed = band_of(telescope.spectrum)
    else:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE, f"The instrument {telescope.name!r} has no band; give --filter."
        )
    return Throughput(passed, glass, plates, IMX183_QE if qe is None else read_curve(qe))


def _area(telescope: Instrument) -> float:
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.photons import collecting_area

    if telescope.pupil is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE, f"The instrument {telescope.name!r} has no pupil; give --area in cm2."
        )
    return collecting_area(telescope.pupil)


def _exposure(telescope: Instrument) -> float:
    from jitterkit.errors import ConfigurationError, ErrorCode

    if telescope.exposure is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE,
            f"The instrument {telescope.name!r} has no exposure; give --exposure in s.",
        )
    return telescope.exposure


def _rows(lines: list[Line]) -> list[str]:
    """The table as text, columns aligned; a column in which nobody says anything is left out."""
    from jitterkit.report.words import number

    published = [
        name for name in ("paper", "notebook") if any(not isnan(getattr(line, name)) for line in lines)
    ]
    cells = [["", "here", *published, ""]]
    for line in lines:
        values = [number(getattr(line, name)) for name in ("here", *published)]
        cells.append([line.quantity, *values, line.unit])
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]


def _write(path: Path, lines: list[Line], overwrite: bool) -> None:
    from astropy.table import QTable

    from jitterkit.report.table import write_table

    names = ("quantity", "unit", "here", "paper", "notebook")
    columns = [[getattr(line, name) for line in lines] for name in names]
    write_table(path, QTable(columns, names=names, meta={"command": command_line()}), overwrite=overwrite)
    say(f"wrote {path}")
