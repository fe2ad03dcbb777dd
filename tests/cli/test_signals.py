"""Ctrl-C, a scheduler's SIGTERM and the SIGHUP of a closed terminal end a command alike."""

import os
import signal

import pytest

from jitterkit.cli.runtime import as_interrupt, until_interrupted

ENDS = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@pytest.fixture(params=ENDS)
def number(request):
    """A signal that is not ignored, as all are at a terminal."""
    number = getattr(signal, request.param)
    before = signal.signal(number, signal.default_int_handler)
    yield number
    signal.signal(number, before)


def test_who_asks_once_is_waited_for_and_who_asks_twice_is_not(number, capsys):
    with until_interrupted() as interrupted:
        assert not interrupted()
        os.kill(os.getpid(), number)
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert capsys.readouterr().err.count("Ctrl-C") == 1
    assert signal.getsignal(number) is signal.default_int_handler


def test_what_ends_a_command_interrupts_it(number):
    signal.signal(number, signal.SIG_DFL)  # which would end this process
    with pytest.raises(KeyboardInterrupt), as_interrupt():
        os.kill(os.getpid(), number)
    assert signal.getsignal(number) is signal.SIG_DFL


def test_what_is_ignored_stays_ignored(number):
    """As in a script behind an ampersand, or under nohup."""
    signal.signal(number, signal.SIG_IGN)
    with as_interrupt(), until_interrupted() as interrupted:
        os.kill(os.getpid(), number)
        assert not interrupted()
    assert signal.getsignal(number) is signal.SIG_IGN
