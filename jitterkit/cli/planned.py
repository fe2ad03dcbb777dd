"""``process --tolerance``, ``--budget`` and ``--explain``: settings chosen for the frames of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jitterkit.cli.quantities import parse_allowed, parse_time
from jitterkit.cli.runtime import say

if TYPE_CHECKING:
    from jitterkit.batch import Processor
    from jitterkit.trade import Settings

__all__ = ["check_asked", "with_plan"]


def check_asked(tolerance: str | None, budget: str | None) -> None:
    """Refuse what is no angle, share or time, and two questions at once.

    Raises
    ------
    ConfigurationError
    """
    from jitterkit.errors import ConfigurationError, ErrorCode

    if tolerance is not None and budget is not None:
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            "--tolerance asks for the cheapest settings, --budget for the most exact; give one of the two.",
        )
    _meaning({"tolerance": tolerance, "budget": budget})


def _meaning(asked: Mapping[str, str | None]) -> tuple[tuple[str, float] | None, float | None]:
    """What may be lost, and seconds a frame."""
    tolerance, budget = asked["tolerance"], asked["budget"]
    allowed = None if tolerance is None else parse_allowed(tolerance, "--tolerance", "error")
    return allowed, None if budget is None else parse_time(budget, "--budget")


def with_plan(
    processor: Processor,
    files: Sequence[Path],
    hdu: int | None,
    asked: Mapping[str, str | None],
    resumed: Path | None,
    explain: bool,
) -> tuple[Processor, dict[str, Any] | None]:
    """The processor with the settings that its frames need, and how they were chosen.

    Parameters
    ----------
    processor : Processor
    files : sequence of Path
    hdu : int, optional
    asked : mapping
        ``tolerance`` and ``budget``, as the command line has them, at most one; by none the settings stay.
    resumed : Path, optional
        Directory of a run that goes on with the settings that it began with.
    explain : bool
        Whether to say what the settings leave out.

    Raises
    ------
    ConfigurationError
        If what is asked for is no quantity, cannot be had, or no frame can be fitted.
    """
    from jitterkit.batch.configuration import describe
    from jitterkit.batch.run import planned_before
    from jitterkit.trade import Settings

    before = None if resumed is None else planned_before(resumed)
    if before is not None and _meaning(before["asked"]) == _meaning(asked):
        say("going on with the settings that were chosen when the run began")
        return Settings(**before["settings"]).applied(processor), dict(before)
    settings = _choose(processor, files, hdu, asked, explain)
    if not any(asked.values()):
        return processor, None
    return settings.applied(processor), {"asked": dict(asked), "settings": describe(settings)}


def _choose(
    processor: Processor,
    files: Sequence[Path],
    hdu: int | None,
    asked: Mapping[str, str | None],
    explain: bool,
) -> Settings:
    """Look at some frames, and say what is expected of the settings that suit them."""
    from jitterkit.report.words import angle_size
    from jitterkit.trade.examples import examples_of
    from jitterkit.trade.explain import explain as sentences
    from jitterkit.trade.plan import Planner

    allowed, seconds = _meaning(asked)
    say("looking at some frames, to know what their model needs ...")
    planner = Planner(*examples_of(files, processor, hdu))
    if allowed is not None:
        kind, size = allowed
        plan = planner.cheapest(size * planner.outlook.sigma if kind == "error" else size)
    elif seconds is not None:
        plan = planner.within(seconds)
    else:
        plan = planner.as_they_are()
    say(
        f"{1e3 * plan.seconds:.3g} ms a frame; what its model leaves out may cost {angle_size(plan.loss, 2)} "
        f"of a separation that one frame tells to {angle_size(planner.outlook.sigma)}"
    )
    for sentence in sentences(planner.outlook, plan) if explain else ():
        say(f"  {sentence}")
    return plan.settings
