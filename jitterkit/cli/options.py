"""Declare the options that several commands share, in groups that turn them into records of the package.

Parameters
----------
files : FILES_OR_DIRS
    FITS or TIFF files, or directories of them.
output : DIR
    Directory for the results.
overwrite
    Replace files that exist.
instrument : NAME|FILE.toml
    A preset, or an instrument file.
hdu
    HDU to read; by default the first that holds an image.
scene : auto|star|binary|stars
    Scene of the frames; auto is the simplest scene that they support.
background
    Fit a background and its gradient. If they are held at zero, a sky of 1 e-/pixel biases a separation by
    43 µas.
model_error : FRACTION|auto
    Error of the modelled light in each pixel, as a share of it, where the optics are not known exactly: added
    to the noise; auto takes what each frame shows.
censored
    Treat saturated pixels as lower limits, instead of excluding all pixels near saturation. This keeps the
    error small, and needs a response that is linear up to saturation.
kind : bins|curve
    Rows of the spectrum: bins of a measured spectrum (such as Welch's), which hold power, or points of a
    drawn curve, with power laws between them. By default their spacing decides.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from jitterkit.cli.loci import locus_sizes, other_sizes, parse_sizes
from jitterkit.cli.runtime import command_line, write_picture
from jitterkit.errors import ConfigurationError, ErrorCode, one_of, refuse_if

if TYPE_CHECKING:
    from astropy.table import QTable

    from jitterkit.instruments import Instrument
    from jitterkit.scene import Scene, Stars


T = TypeVar("T")

OF_PAIRS = ("separation", "theta", "contrast")
"""Options that only a pair uses."""


Files = Annotated[list[Path], typer.Argument()]
OutputDirectory = Annotated[Path, typer.Option("--output", "-o")]
InstrumentName = Annotated[str, typer.Option("--instrument", "-i")]
TableOutput = Annotated[Path | None, typer.Option("--output", "-o")]

_LOCUS = typer.Option(metavar="NAME", help=f"Jitter: {', '.join(locus_sizes())}.")


@dataclass(frozen=True)
class Detector:
    """Replace what headers and instrument say of the detector and of the exposure.

    Parameters
    ----------
    gain
        Gain, e-/ADU.
    read_noise
        Read noise, e-.
    bias
        Bias level, ADU.
    saturation
        Saturation level, ADU.
    plate_scale
        Plate scale, arcsec/pixel.
    exposure
        Exposure time, s.
    bad_bits : SUM
        Bits of a DQ or MASK extension that mask a pixel, as the sum of their values; 0 for none. By default
        the bits that the observatory defines as bad.
    """

    gain: float | None = None
    read_noise: float | None = None
    bias: float | None = None
    saturation: float | None = None
    plate_scale: float | None = None
    exposure: float | None = None
    bad_bits: Annotated[int | None, typer.Option(min=0)] = None

    def metadata(self) -> dict[str, Any]:
        """Return the metadata that were given, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class Jitter:
    """Describe a jitter by the name of its locus and its sizes.

    Parameters
    ----------
    length
        Full length, or peak to peak of a vibration, arcsec.
    sigma
        One sigma along the major axis, arcsec.
    shear
        1 - sigma_minor/sigma_major (mvn), 0 to 1.
    angle
        Axis of the jitter, degrees counter-clockwise from +x.
    """

    locus: Annotated[str, _LOCUS] = "stable"
    length: float | None = None
    sigma: float | None = None
    shear: float | None = None
    angle: float | None = None
    sizes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="SIZE=VALUE",
            help="Any other size of the locus: --set cycles=0.7 --set phase=30; positions in arcsec: --set "
            f"knots=0:0,0.2:0.1,0.3:0.3. There are {other_sizes()}.",
        ),
    ] = None

    def size_values(self) -> dict[str, Any]:
        """Return the sizes that were given, by name."""
        own = {"length": self.length, "sigma_major": self.sigma, "shear": self.shear, "angle": self.angle}
        given = {name: size for name, size in own.items() if size is not None}
        return given | parse_sizes(self.sizes or [], given)


@dataclass(frozen=True)
class Pair:
    """Describe a binary in front of a telescope.

    Parameters
    ----------
    separation
        Separation, arcsec.
    theta
        Direction from A to B, degrees counter-clockwise from +x.
    x
        Position of the midpoint of the pair along x, arcsec from the frame's centre.
    y
        Position of the midpoint of the pair along y (upwards), arcsec from the frame's centre.
    flux
        Photons detected per frame from both stars; by default the instrument's.
    contrast
        Flux of A over flux of B.
    """

    separation: float = 10.0
    theta: float = 180.0
    x: float = 0.0
    y: float = 0.0
    flux: float | None = None
    contrast: float = 3.37

    def parameters(self, telescope: Instrument) -> dict[str, float]:
        """Return the parameters by name, with the instrument's usual flux where none is given."""
        flux = required(telescope, "usual flux; give --flux", self.flux, telescope.flux)
        return asdict(self) | {"flux": flux}

    def of(self, scene: str, telescope: Instrument) -> dict[str, float]:
        """Return the parameters that a scene has: of ``stars`` only by how much they are moved."""
        if scene == "stars":
            return {"x": self.x, "y": self.y}
        unused = OF_PAIRS if scene == "star" else ()
        return {name: value for name, value in self.parameters(telescope).items() if name not in unused}


def read_stars(path: Path | None) -> Stars | None:
    """Return the stars of a table, if there is one."""
    from jitterkit.simulate import read_stars as read

    return None if path is None else read(path)


def sources(values: Mapping[str, float], stars: Stars | None) -> Scene:
    """Return the scene of some parameters; stars of a table are beside it, or all that there is."""
    from jitterkit.scene import Binary, FurtherStars, Star

    if stars is not None and "flux" not in values:
        return stars.shifted(values["x"], values["y"])
    scene = Binary(**values) if "separation" in values else Star(**values)
    return scene if stars is None else scene.joined(FurtherStars(*stars.sources()))


def refuse_given(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Refuse options that were given and would have no effect; ``why`` follows the option in the sentence.

    Raises
    ------
    ConfigurationError
    """
    for name in names:
        source, option = context.get_parameter_source(name), f"--{name.replace('_', '-')}"
        given = source is not None and source.name == "COMMANDLINE"
        refuse_if(given, ErrorCode.CONFLICT, f"{option} {why}; leave it out.")


def check_scene_options(
    scene: str, stars: Path | None, unused: Mapping[str, Collection[str]], context: typer.Context
) -> None:
    """Refuse an unknown scene, options that the scene does not use, and a scene of stars without a table.

    Raises
    ------
    ConfigurationError
    """
    refuse_given(context, unused[one_of("scene", scene, unused)], f"is not used by --scene {scene}")
    problem = "--scene stars needs their table: give --stars."
    refuse_if(scene == "stars" and stars is None, ErrorCode.MISSING_VALUE, problem)


def parse_model_error(text: str) -> Any:
    """Read a model error as it is given on the command line."""
    try:
        return text if text == "auto" else float(text)
    except ValueError:
        problem = f"--model-error {text!r} is no number; give a share, such as 0.02, or auto."
        raise ConfigurationError(ErrorCode.MALFORMED, problem) from None


def held(background: bool) -> tuple[str, ...]:
    """Return the names of parameters that a fit holds at zero."""
    return () if background else ("background",)


def required(telescope: Instrument, problem: str, *values: T | None) -> T:
    """Return the first value that is known, of the command line's and the instrument's; refuse if none is.

    Raises
    ------
    ConfigurationError
    """
    for value in values:
        if value is not None:
            return value
    message = f"The instrument {telescope.name!r} has no {problem}."
    raise ConfigurationError(ErrorCode.MISSING_VALUE, message)


@dataclass(frozen=True, kw_only=True)
class Products:
    """Choose the files that a command writes; the docstring of the command describes its picture.

    Parameters
    ----------
    plot : FILE.png
        Draw the result.
    output : FILE.ecsv
        Also write the table; the name ends in .ecsv, .csv, .fits, .parquet or .json.
    """

    plot: Path | None = None
    output: TableOutput = None
    overwrite: bool = False

    def check(self) -> None:
        """Refuse a picture that is no PNG, a table of unknown ending, and files that cannot be written.

        Raises
        ------
        ConfigurationError
        """
        from jitterkit.report.outputs import check_file, check_table

        if self.plot is not None:
            check_file(self.plot, self.overwrite, ".png")
        if self.output is not None:
            check_table(self.output, self.overwrite)

    def write(self, table: QTable, draw: Callable[[], Any]) -> None:
        """If requested, write a table with the command that made it, and draw the result on some axes."""
        from jitterkit.report.table import write_table

        if self.output is not None:
            table.meta["command"] = command_line()
            write_table(self.output, table, overwrite=self.overwrite)
        if self.plot is not None:
            write_picture(self.plot, draw(), self.overwrite)
