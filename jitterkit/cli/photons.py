"""Count the photons of the pair in an exposure: ``jitterkit photons``."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import aligned, log, naming, open_instrument

if TYPE_CHECKING:
    from jitterkit.instruments import Instrument
    from jitterkit.photons import Curve, Line, Throughput


def photons(
    context: typer.Context,
    *,
    instrument: options.InstrumentName = "toliman",
    spectrum_a: Path | None = None,
    spectrum_b: Path | None = None,
    temperatures: tuple[float, float] = (5790.0, 5260.0),
    magnitudes: tuple[float, float] = (0.01, 1.33),
    filter_file: Annotated[Path | None, typer.Option("--filter")] = None,
    glass: float = 0.91,
    plates: Annotated[int, typer.Option(min=0)] = 2,
    qe: Path | None = None,
    exposure: float | None = None,
    area: float | None = None,
    products: options.Products,
) -> None:
    """Count the photons of alpha Cen AB in an exposure, beside the paper's.

    Parameters
    ----------
    spectrum_a : FILE.csv
        Spectrum of A: wavelength_nm, photons per nm in any unit; it is scaled to V. By default a blackbody.
    spectrum_b : FILE.csv
        Spectrum of B, in the same form.
    temperatures : A B
        Temperatures of the blackbodies, K.
    magnitudes : A B
        V magnitudes of the stars.
    filter_file : FILE.csv
        Transmission of the filter: wavelength_nm, value from 0 to 1. By default the instrument's band,
        without loss.
    glass
        Transmission of a glass plate.
    plates
        Number of plates.
    qe : FILE.csv
        Quantum efficiency: wavelength_nm, value from 0 to 1. By default the nominal one of an IMX183.
    exposure
        Exposure time, s.
    area
        Collecting area, cm2; by default that of the instrument's pupil.
    plot : FILE.png
        Draw spectra and throughput.
    """
    products.check()
    unused = ("temperatures",) if spectrum_a is not None and spectrum_b is not None else ()
    options.refuse_given(context, unused, "is for stars without a spectrum")
    options.refuse_given(context, ["glass"] if plates == 0 else [], "is not used with --plates 0")
    telescope = open_instrument(instrument)
    from jitterkit.photons import collecting_area, compare, count_photons

    star_a = _star(spectrum_a, temperatures[0], magnitudes[0])
    star_b = _star(spectrum_b, temperatures[1], magnitudes[1])
    throughput = _throughput(telescope, filter_file, glass, plates, qe)
    if area is None:
        area = collecting_area(options.required(telescope, "pupil; give --area in cm2", telescope.pupil))
    seconds = options.required(telescope, "exposure; give --exposure in s", exposure, telescope.exposure)
    budget = count_photons((star_a, star_b), throughput, area=area, exposure=seconds)
    lines = compare(budget, published=telescope.name.startswith("toliman"))
    typer.echo("\n".join(aligned(_rows(lines))))

    def draw():
        from jitterkit.report.photon_plots import plot_photons

        return plot_photons(budget)[0]

    products.write(_table(lines), draw)
    if products.output is not None:
        log(f"wrote {products.output}")


def _star(path: Path | None, temperature: float, magnitude: float) -> Curve:
    from jitterkit.photons import blackbody, read_curve, tabulated

    if path is None:
        return blackbody(temperature, magnitude)
    with naming(path):
        return tabulated(read_curve(path, "photons"), magnitude)


def _throughput(
    telescope: Instrument, filter_file: Path | None, glass: float, plates: int, qe: Path | None
) -> Throughput:
    from jitterkit.photons import IMX183_QE, Throughput, band_of, read_curve

    if filter_file is not None:
        passed = read_curve(filter_file)
    else:
        passed = band_of(options.required(telescope, "band; give --filter", telescope.spectrum))
    return Throughput(passed, glass, plates, IMX183_QE if qe is None else read_curve(qe))


def _rows(lines: list[Line]) -> list[list[str]]:
    """Return the cells of the table, without columns that are empty."""
    from jitterkit.report.words import number

    published = [
        name for name in ("paper", "notebook") if any(not isnan(getattr(line, name)) for line in lines)
    ]
    cells = [["", "here", *published, ""]]
    for line in lines:
        values = [number(getattr(line, name)) for name in ("here", *published)]
        cells.append([line.quantity, *values, line.unit])
    return cells


def _table(lines: list[Line]):
    from jitterkit.report.columns import Column, bind

    texts = (Column(name, kind=str) for name in ("quantity", "unit"))
    columns = (*texts, *map(Column, ("here", "paper", "notebook")))
    return bind((column, [getattr(line, column.name) for line in lines]) for column in columns)
