"""The handbook: Markdown pages that are installed with the package.

Reach for :func:`topics`, which lists them, and :func:`read_page`; ``jitterkit docs`` shows them in a
terminal.
"""

from __future__ import annotations

from importlib.resources import files

from jitterkit.errors import ConfigurationError, ErrorCode, did_you_mean

_FOLDERS = ("", "commands/", "results/")
"""Of the pages, in the order in which they are listed; the pages of commands go by the command's name."""

_FIRST = ("quickstart", "results", "troubleshooting", "recipes")
"""Pages to begin with; the others follow by name."""


def topics() -> dict[str, str]:
    """Return the title of every page by its topic.

    Returns
    -------
    titles : dict
        Pages of commands have the command's name, results of studies begin with ``results/``.

    >>> topics()["results"]
    'Results and how to read them'
    """
    return {topic: text.partition("\n")[0].lstrip("# ") for topic, text in _pages().items()}


def read_page(topic: str) -> str:
    """Return the Markdown of a page.

    Parameters
    ----------
    topic : str
        A key of :func:`topics`.

    Raises
    ------
    ConfigurationError
        If there is no page of that name; the message gives the closest one.
    """
    pages = _pages()
    name = topic.removesuffix(".md").removeprefix("commands/")
    if name not in pages:
        problem = f"There is no page {topic!r}"
        remedy = f"{did_you_mean(name, pages)}'jitterkit docs' lists the pages"
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; {remedy}.")
    return pages[name]


def _pages() -> dict[str, str]:
    found: dict[str, str] = {}
    for folder in _FOLDERS:
        pages = {
            folder.replace("commands/", "") + entry.name.removesuffix(".md"): entry.read_text(
                encoding="utf-8"
            )
            for entry in files(__package__).joinpath(folder).iterdir()
            if entry.name.endswith(".md")
        }
        found |= {name: pages[name] for name in sorted(pages, key=_rank)}
    return found


def _rank(name: str) -> tuple[int, str]:
    return (_FIRST.index(name) if name in _FIRST else len(_FIRST)), name
