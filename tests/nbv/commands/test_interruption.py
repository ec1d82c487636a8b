# SPDX-License-Identifier: MIT
"""What ends a command ends it in one line, though native code on the way made another error of it."""

import signal

import pytest
import typer

from nbv.commands.process import Interruption, interruptible


def raised_within_native_code() -> None:
    try:
        raise Interruption(signal.SIGTERM)
    except Interruption as error:
        raise SystemError("returned a result with an exception set") from error


def test_an_interruption_within_native_code_is_one(capsys):
    with pytest.raises(typer.Exit) as ended, interruptible("study"):
        raised_within_native_code()
    assert ended.value.exit_code == 128 + signal.SIGTERM
    assert "unseen study: ended by SIGTERM" in capsys.readouterr().err


def test_other_errors_of_native_code_stay_errors():
    with pytest.raises(SystemError, match="bad call"), interruptible("study"):
        raise SystemError("bad call")
