# SPDX-License-Identifier: MIT
"""Interruption: Ctrl-C and SIGTERM end a command in one line, after what it was writing is put away."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import typer


class Interruption(KeyboardInterrupt):
    """A signal, by its number, that asks the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def interruptible(command: str) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM raise in the main thread; tell it in one line, exit with 128 + their number.

    Files are written whole or not at all, so that those of the run before are still there, or those of this
    one, and nothing in between.
    """
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.signal(number, _raise) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except (KeyboardInterrupt, SystemError) as error:
        cause = _keyboard_interrupt(error)
        if cause is None:
            raise
        number = cause.number if isinstance(cause, Interruption) else int(signal.SIGINT)
        name = signal.Signals(number).name
        handlers.clear()  # the process ends, and what else comes must not disturb that
        typer.echo(f"unseen {command}: ended by {name}; every file is whole: run it again to go on", err=True)
        raise typer.Exit(128 + number) from None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _keyboard_interrupt(error: BaseException | None) -> KeyboardInterrupt | None:
    """What interrupted, though native code that called back into Python made a SystemError of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _raise(number: int, _frame: FrameType | None) -> None:
    for other in (signal.SIGINT, signal.SIGTERM):  # once is enough: what is put away meanwhile shall be whole
        signal.signal(other, signal.SIG_IGN)
    raise Interruption(number)
