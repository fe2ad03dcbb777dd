"""Coverage-guided damage, for ``scripts/fuzz_frames --guided``: what it runs, and what atheris takes over."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from fuzz_mutations import mutated
from fuzz_reading import ended
from fuzz_seeds import seeds

__all__ = ["guided"]


def guided(options: argparse.Namespace) -> int:
    """Let atheris look for new paths through the readers; return the exit status."""
    if options.kind == "both":
        raise SystemExit("--guided needs --kind fits or --kind tiff: one format at a time")
    try:
        import atheris  # noqa: F401
    except ImportError:
        raise SystemExit("--guided needs atheris: pip install atheris") from None
    options.keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        corpus = Path(scratch, "corpus")
        corpus.mkdir()
        for number, (_, content) in enumerate(seeds(options.kind, options.real)):
            if len(content) < 60_000:
                (corpus / f"{number:03d}").write_bytes(content)
        environment = {**os.environ, "FUZZ_KIND": options.kind, "FUZZ_KEEP": str(options.keep)}
        flags = [
            *(f"-max_total_time={options.guided:g}", f"-seed={options.seed}", f"-timeout={options.limit:g}"),
            *(f"-rss_limit_mb={options.memory + 1000}", f"-artifact_prefix={options.keep}/"),
            *("-max_len=60000", "-len_control=0", "-print_final_stats=1"),
        ]
        command = [sys.executable, __file__, *flags, str(corpus)]
        done = subprocess.run(
            command, env=environment, stderr=subprocess.PIPE, text=True, errors="replace", check=False
        )
    lines = [line for line in done.stderr.splitlines() if line.startswith(("#", "stat::"))]
    shown = [line for line in lines if "INITED" in line or line.startswith("stat::")] + lines[-12:]
    print("\n".join(dict.fromkeys(shown)))
    findings = sorted(options.keep.glob(f"guided-{options.kind}-*.txt"))
    for finding in findings:
        print(f"  {finding.stem}: {finding.read_text()}")
    if done.returncode:
        print(done.stderr[-3000:])
    return 1 if done.returncode or findings else 0


def _child(arguments: list[str]) -> None:
    """The process that atheris takes over; it ends with it."""
    import atheris

    with atheris.instrument_imports(include=["astropy.io.fits", "tifffile", "jitterkit.frames"]):
        import jitterkit.frames.fits
        import jitterkit.frames.tiff  # noqa: F401
    kind, keep = os.environ["FUZZ_KIND"], Path(os.environ["FUZZ_KEEP"])
    folder = Path(tempfile.mkdtemp())
    path = folder / ("frame.tif" if kind == "tiff" else "frame.fits")
    seen: set[str] = set()

    def one(content: bytes) -> None:
        path.write_bytes(content)
        outcome = ended(path)
        where = outcome.rsplit("(", 1)[-1]
        if outcome.startswith("finding") and where not in seen:
            seen.add(where)
            name = f"guided-{kind}-{len(seen):03d}"
            shutil.copy(path, keep / f"{name}{path.suffix}")
            (keep / f"{name}.txt").write_text(outcome)

    def mutate(content: bytes, most: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        return (mutated(content, rng) if rng.random() < 0.6 else atheris.Mutate(content, most))[:most]

    atheris.Setup([sys.argv[0], *arguments], one, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    _child(sys.argv[1:])
