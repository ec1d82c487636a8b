# SPDX-License-Identifier: MIT
"""Defaults of a project: options of commands in `unseen.toml`, in the folder where a command is run."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

FILE = "unseen.toml"
_PLAIN = (str, int, float, bool)


def project_defaults(folder: Path, names: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Any]]:
    """Return the defaults of a folder's `unseen.toml` by command and parameter; none without the file.

    The table `[complete]` holds options of `unseen complete` by their long names without dashes, `[all]`
    those of every command that has them::

        [all]
        threads = 4
        [complete]
        up = "z"
        export = ["svg", "ifc"]

    Parameters
    ----------
    folder : Path
        Where the command is run.
    names : mapping
        For each command the parameters of its options by their long names.

    Raises
    ------
    BadParameter
        The file is no TOML, or names a command or option that is not there; nothing is taken then.
    """
    file = folder / FILE
    if not file.is_file():
        return {}
    try:
        held = tomllib.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"{file}: cannot be read as TOML: {error}") from None
    defaults: dict[str, dict[str, Any]] = {command: {} for command in names}
    for command, table in held.items():
        if (command != "all" and command not in names) or not isinstance(table, dict):
            raise typer.BadParameter(
                f"{file}: [{command}] is no command; write a table [all], or of {', '.join(names)}"
            )
        for option, value in table.items():
            into = [name for name in (names if command == "all" else [command]) if option in names[name]]
            if not into:
                raise typer.BadParameter(f"{file}: [{command}] has no option {option!r}; see --help")
            if not (isinstance(value, _PLAIN) or (isinstance(value, list) and value)):
                raise typer.BadParameter(
                    f"{file}: {option} of [{command}] is a text, a number, true, false or a list of them"
                )
            for name in into:
                if command != "all" or names[name][option] not in defaults[name]:
                    defaults[name][names[name][option]] = value
    return defaults
