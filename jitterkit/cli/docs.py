"""Show the handbook in the terminal: ``jitterkit docs``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer


def docs(*, topic: Annotated[str | None, typer.Argument()] = None) -> None:
    """List the pages of the handbook, or show one.

    Parameters
    ----------
    topic : TOPIC
        A page; without it, all pages are listed.
    """
    from jitterkit.docs import read_page, topics

    if topic is None:
        titles = topics()
        width = max(map(len, titles))
        typer.echo("\n".join(f"{name:<{width}}  {title}" for name, title in titles.items()))
    elif sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(read_page(topic)))
    else:
        typer.echo(read_page(topic), nl=False)
