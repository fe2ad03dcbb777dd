"""The pages of results in the handbook: a section for each command, with what it was measured with."""

from __future__ import annotations

import datetime
import os
import platform
import re
import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path

__all__ = ["machine", "measured_with", "put_section"]


def machine() -> str:
    """Return this machine in words: processor, cores, accelerator, system, Python and JAX."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        entries = [line.partition(":") for line in Path("/proc/cpuinfo").read_text().splitlines()]
        models = [value.strip() for key, _, value in entries if key.strip() == "model name"]
        cpu = models[0] if models else cpu
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (
        f"{cpu}, {cores} cores, {platform.system()}, {_accelerator()}; "
        f"Python {platform.python_version()}, jax {version('jax')}"
    )


def _accelerator() -> str:
    """Return the names of NVIDIA's processors, or that there are none."""
    if shutil.which("nvidia-smi") is None:
        return "no accelerator"
    asked = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    names = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.split("\n")
    return ", ".join(filter(None, names)) or "no accelerator"


def measured_with(repository: Path) -> str:
    """Return version, commit, date and machine of a measurement that is made now."""
    asked = {"cwd": repository, "capture_output": True, "text": True, "check": True}
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], **asked).stdout.strip()
    changed = subprocess.run(["git", "status", "--porcelain", "--untracked-files=no"], **asked).stdout.strip()
    commit += " with changes" if changed else ""
    today = datetime.datetime.now(tz=datetime.UTC).date()
    return f"jitterkit {version('jitterkit')}, commit {commit}, {today}; {machine()}"


def put_section(text: str, name: str, command: str, measured: str, output: str) -> str:
    """Return the text of a page with the section of one command added or replaced.

    Parameters
    ----------
    text : str
        The page as it is; empty for a new one.
    name : str
        Title of a new page.
    command : str
        Heading of the section.
    measured : str
        From :func:`measured_with`.
    output : str
        What the command printed: Markdown if there is a table in it, or else kept as it is in a code block.
    """
    heading = f"## `{command}`\n"
    is_markdown = re.search(r"^\|[ :-]*--", output, re.M)
    body = output.strip("\n")
    body = body if is_markdown else f"```text\n{body}\n```"
    section = f"{heading}\n*{measured}.*\n\n{body}\n"
    before, *sections = re.split(
        r"^(?=## )", text or f"# {name.replace('_', ' ').capitalize()}\n\n", flags=re.M
    )
    positions = [position for position, old in enumerate(sections) if old.startswith(heading)]
    for position in positions[:1]:
        sections[position] = section
    if not positions:
        sections.insert(0, section)  # the latest first
    return "\n\n".join(part.strip("\n") for part in (before, *sections)) + "\n"
