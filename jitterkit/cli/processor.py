"""The options of commands that fit frame by frame, which make the processor of those frames.

Reach for :func:`takes_processor`, which adds them to a command.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.runtime import prepare_jax, say

if TYPE_CHECKING:
    from jitterkit.batch import Processor

__all__ = ["make_processor", "takes_processor"]

_LOCUS = f"Jitter locus: auto (the simplest that the frame supports), {', '.join(locus_sizes())}."


def make_processor(
    instrument: options.InstrumentName = "toliman",
    scene: options.SceneName = "auto",
    locus: Annotated[str, typer.Option(metavar="auto|NAME", help=_LOCUS)] = "auto",
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="Kernel estimator that starts the fit: score or mtf.")
    ] = "score",
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What other data say about the jitter: a table of 'estimate -o' (.ecsv; a frame's own row, "
            "known by its pixels, is left out), or a trace t,x,y (.csv, s and arcsec, good to 10 % of its "
            "rms), the same for every frame: of one longer than an exposure its first, of two exposures or "
            "more their mean and scatter.",
            show_default=False,
        ),
    ] = None,
    censored: options.Censored = False,
    rays: Annotated[
        bool,
        typer.Option(
            "--rays",
            help="Look for cosmic rays in what the fit leaves over, and fit again without their pixels.",
        ),
    ] = False,
    background: options.Background = True,
    gain: options.Gain = None,
    read_noise: options.ReadNoise = None,
    bias: options.Bias = None,
    saturation: options.Saturation = None,
    plate_scale: options.PlateScale = None,
    exposure: options.Exposure = None,
    bad_bits: options.BadBits = None,
    device: options.Device = None,
    float32: options.Float32 = False,
    preset: Annotated[
        str,
        typer.Option(
            metavar="fast|balanced|exact",
            help="How exactly frames are modelled; 'jitterkit trade' measures what that costs on your scene.",
        ),
    ] = "balanced",
) -> Processor:
    """Set JAX up and make a processor of what was given on the command line."""
    prepare_jax(device, float32)
    from jitterkit.batch import Processor
    from jitterkit.instruments import load_instrument
    from jitterkit.refit import FitOptions, read_kernel_prior
    from jitterkit.trade import settings as trade

    telescope = load_instrument(instrument)
    settings = trade.preset(preset, telescope)
    modelled = settings.instrument(telescope)
    if settings != trade.Settings():
        modelled.system()  # refuses what its pupil does not carry before any frame is read
    known = None if prior is None else read_kernel_prior(prior, exposure=exposure or telescope.exposure)
    if known is not None and known.remark:
        say(f"{prior}: {known.remark}")
    return Processor(
        modelled,
        options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure, bad_bits),
        locus=locus,
        kernel=estimator,
        scene=scene,
        options=settings.options(telescope, FitOptions(hold=() if background else ("background",))),
        prior=known,
        censored=censored,
        rays=rays,
    )


def takes_processor(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of :func:`make_processor` behind a command's own.

    The command is called with a function that makes the processor, so that it can look at paths before.
    """
    shared, own = _parameters(make_processor), _parameters(command)
    del own["make"]

    @functools.wraps(command)
    def wrapped(**given: Any) -> None:
        make = functools.partial(make_processor, **{name: given.pop(name) for name in shared})
        command(make, **given)

    parameters = own | shared
    wrapped.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    wrapped.__annotations__ = {name: parameter.annotation for name, parameter in parameters.items()}
    return wrapped


def _parameters(function: Callable) -> dict[str, inspect.Parameter]:
    """Parameters by name, with annotations that need no module to be understood in."""
    hints = get_type_hints(function, {**function.__globals__, "Processor": object}, include_extras=True)
    return {
        name: parameter.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY)
        for name, parameter in inspect.signature(function).parameters.items()
    }
