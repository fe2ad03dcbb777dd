"""Declare the options of a run that writes a directory of results, and report its result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import LISTED, SOME_FAILED, command_line, log
from jitterkit.report.words import angle_size, by_scale, ellipse_size, with_error

_REPORTED = {"prior_contradicted", "prior_unused", "prior_namesake"}
"""Flags of fitted frames that are worth a line on stderr."""

_DOUBTS = ("header_odd", "gain_assumed", "read_noise_assumed", "bias_assumed", "above_adc_range", "other")
"""Flags of fitted frames whose files or detectors leave a number in doubt, worth a line for all frames."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Choose what happens to the results of an earlier run.

    Parameters
    ----------
    resume
        Continue an interrupted run; no frame is fitted twice.
    """

    overwrite: options.Overwrite = False
    resume: bool = False

    def check(self, output: Path) -> None:
        """Refuse a directory that cannot be written, or that holds results which may not be replaced.

        Raises
        ------
        ConfigurationError
        """
        from jitterkit.report.outputs import RUN, check_directory

        check_directory(output, RUN, self.overwrite or self.resume)

    def settings(self) -> dict[str, Any]:
        """Return the settings of the executor."""
        return {"overwrite": self.overwrite, "resume": self.resume, "command": command_line()}


def finalize(run, telescope) -> None:
    """Report the result of a run; exit with status 1 if some frames were not fitted."""
    _list_frames(run)
    _list_doubts(run)
    _echo_result(run)
    warn_of_rolling_shutter(run, telescope)
    if run.failures:
        raise typer.Exit(SOME_FAILED)


def _list_frames(run) -> None:
    """Log the frames that were not fitted, and those whose prior was not used."""
    from jitterkit.report.flags import decode_flags

    rows = ((row, set(decode_flags(row["flags"]))) for row in run.table)
    listed = [row for row, flags in rows if row["status"] != "ok" or _REPORTED & flags]
    for row in listed[:LISTED]:
        log(f"{row['file']} [{row['frame']}] {row['status']}: {row['message']}")
    if len(listed) > LISTED:
        log(f"... and {len(listed) - LISTED} more, which the table and the report have")


def _list_doubts(run) -> None:
    """Log how many fitted frames have a flag that leaves a number in doubt, with the first one's message."""
    from jitterkit.report.flags import decode_flags

    fitted = run.table[run.table["status"] == "ok"]
    flags = [decode_flags(code) for code in fitted["flags"]]
    counts = {flag: sum(flag in words for words in flags) for flag in _DOUBTS}
    if any(counts.values()):
        shown = ", ".join(f"{flag} ({count})" for flag, count in counts.items() if count)
        row = fitted[next(index for index, words in enumerate(flags) if set(_DOUBTS) & set(words))]
        log(f"Flags of fitted frames: {shown}. {row['file']} [{row['frame']}]: {row['message']}")


def _echo_result(run) -> None:
    """Print the separation, or the jitter of stars, on stdout; log the rest."""
    from jitterkit.report import sequence

    fitted = int(sum(run.table["status"] == "ok"))
    separation, jitter = run.summary["separation"], run.summary["jitter"]
    if pairs := separation["n"]:
        value = with_error(separation["mean"], separation["error"])
        typer.echo(f"separation {value} arcsec from {pairs} frames{by_scale(separation['scale_error'])}")
        doubts = sequence.describe_misfits(separation), sequence.describe_scatter(run.table, separation)
        for sentence in filter(None, doubts):
            typer.echo(sentence)
        if (right := run.summary["separation_corrected"])["n"]:
            value = with_error(right["mean"], right["error"])
            typer.echo(f"separation_corrected {value} arcsec from {right['n']} frames")
        if separation["model_error"] > 0:
            size = angle_size(separation["model_error"], 2)
            log(f"Errors of the model may move every frame alike, by {size}: that does not average out.")
    elif fitted:
        size = ellipse_size(jitter["major"], jitter["minor"])
        typer.echo(f"jitter, 1 sigma, {size} from {fitted} frames")
    if loci := sequence.describe_loci(run.summary["loci"]):
        log(loci)
    if misfit := sequence.describe_run_fit(run.summary["fit"]):
        typer.echo(misfit)
    log(f"{fitted} of {len(run.table)} frames fitted; results in {run.directory}")


def warn_of_rolling_shutter(run, telescope) -> None:
    """Log what a rolling shutter may have done to the separation, which one frame does not show."""
    from jitterkit.detectors import detector_preset

    detector, summary = telescope.detector, run.summary["separation"]
    line_time, separation = detector.line_time, summary["mean"]
    drifts = 2 * run.summary["locus"].get("linear", 0) > summary["n"] > 0
    rolls = any("IMX183" in source for source in detector.sources.values())
    if drifts and rolls and line_time is None:
        # the variance of a drift is its length squared over twelve
        speed = run.summary["jitter"]["major"] * math.sqrt(12) / telescope.exposure
        row = detector_preset("imx183").line_time or 0.0
        moved = speed * row * separation / telescope.plate_scale
        if moved > summary["error"]:
            size = angle_size(moved, 2)
            log(
                "The rows of an IMX183 are exposed one after the other, and line_time is not known: a "
                f"drift of {angle_size(speed)} per second moves the separation by up to {size}. Give "
                f"line_time in [detector]: {row:g} as toliman-camera has it, 0 if rows are exposed at once."
            )
    elif line_time and separation == separation:  # not NaN
        leverage = abs(line_time) * separation / telescope.plate_scale
        log(
            "The rows of this detector are exposed one after the other, which one frame does not show: a "
            f"drift along the pair and the columns moves its separation by {angle_size(leverage, 2)} per "
            "arcsec/s. 'jitterkit sequence' takes it out."
        )
