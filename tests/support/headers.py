"""Headers of a few cards, and what is read from them."""

import pytest
from astropy.io import fits

from jitterkit.frames import resolve_header


def header(cards):
    """A header of cards, each a value or ``(value, comment)``."""
    entries = ((key, entry if isinstance(entry, tuple) else (entry,)) for key, entry in cards.items())
    return fits.Header([(key, *entry) for key, entry in entries])


def assert_warned(warnings, named):
    """Check that a warning names what is expected; that there is none where nothing is."""
    assert any(named in text for text in warnings) if named else not warnings, warnings


def assert_number(cards, name, value, named):
    """Check a number of a header, None where it must not be guessed, and what a warning names.

    A number that is not there needs no warning.
    """
    metadata = resolve_header(header(cards))
    got = metadata.value(name)
    assert got is None if value is None else got == pytest.approx(value, rel=1e-12)
    if named or value is not None:
        assert_warned(metadata.warnings, named)
