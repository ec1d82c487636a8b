# SPDX-License-Identifier: MIT
"""Command line: typer commands made from the dataclasses that declare their options (`scenes.run.option`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields
from importlib import import_module
from inspect import Parameter, Signature
from typing import Annotated, Any, get_type_hints

import typer

from nbv.commands.options import Shared
from scenes.run.option import Option


def command_of(name: str, kind: type, work: str, without: tuple[str, ...] = ()) -> Callable[..., None]:
    """Return the typer command of a dataclass of options.

    It makes `kind` and `Shared` of what was typed, asks `kind.check` where there is one, imports the module
    of `work` ("module:function") and calls the function with both. Options of `Shared` may be left `without`.
    """
    shared, asked = dict(_entries(Shared, without)), dict(_entries(kind))

    def run(**typed: Any) -> None:
        try:
            common = _made(Shared, typed, without)
            options = _made(kind, typed)
        except ValueError as error:  # an InputError: options that no work can take
            raise typer.BadParameter(str(error)) from None
        check = getattr(options, "check", None)
        if check is not None:
            check()
        module, function = work.split(":")
        getattr(import_module(module), function)(common, options)

    parameters = [_parameter(entry, hint) for entry, hint in {**asked, **shared}.values()]
    parameters.sort(key=lambda parameter: parameter.default is not Parameter.empty)
    run.__name__ = name
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__annotations__["return"] = None
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # functions may have one: PEP 362
    return run


def _entries(kind: type, without: tuple[str, ...] = ()) -> Iterator[tuple[str, tuple[Field[Any], Any]]]:
    """Yield the options of a dataclass and of the groups in it: name, field and type."""
    hints = get_type_hints(kind)
    for entry in fields(kind):
        if "group" in entry.metadata:
            yield from _entries(entry.metadata["group"], entry.metadata["without"])
        elif "option" in entry.metadata and entry.name not in without:
            yield entry.name, (entry, hints[entry.name])


def _parameter(entry: Field[Any], hint: Any) -> Parameter:
    """Return a function's parameter that typer takes for the option of a field."""
    declared: Option = entry.metadata["option"]
    default = None if entry.default is MISSING else entry.default
    is_required = entry.default is MISSING and entry.default_factory is MISSING
    if declared.is_negated:
        default = False
    elif declared.is_repeated:
        hint = list[str] if is_required else list[str] | None
        default = None
    elif declared.parse is not None:
        hint = str if is_required or isinstance(default, str) else str | None
        default = default if isinstance(default, str) else None
    more: dict[str, Any] = {"help": declared.help, "show_default": declared.shown}
    if declared.metavar is not None:
        more["metavar"] = declared.metavar
    limits = declared.limits
    if limits.above is None:
        more |= {"min": limits.least, "max": limits.most}
    flags = declared.flags.split()
    info = typer.Option(*flags, **more) if flags else typer.Argument(**more)
    return Parameter(
        entry.name,
        Parameter.POSITIONAL_OR_KEYWORD,
        default=Parameter.empty if is_required else default,
        annotation=Annotated[hint, info],
    )


def _made(kind: type, typed: Mapping[str, Any], without: tuple[str, ...] = ()) -> Any:
    """Return a dataclass of options from what was typed; a text without meaning is a usage error."""
    values: dict[str, Any] = {}
    for entry in fields(kind):
        if "group" in entry.metadata:
            values[entry.name] = _made(entry.metadata["group"], typed, entry.metadata["without"])
        elif "option" in entry.metadata and entry.name not in without and typed[entry.name] is not None:
            values[entry.name] = _value(entry.metadata["option"], typed[entry.name])
    return kind(**values)


def _value(declared: Option, typed: Any) -> Any:
    """Return the value of an option from what was typed."""
    if declared.is_negated:
        return not typed
    if isinstance(typed, float) and not math.isfinite(typed):
        unit = " of metres" if declared.metavar == "M" else ""
        raise typer.BadParameter(f"{declared.flags} is a finite number{unit}, got {typed:g}")
    if declared.parse is None:
        return tuple(typed) if declared.is_repeated else typed
    try:
        return declared.parse(typed)
    except ValueError as error:
        hint = declared.flags.split()[0] if declared.flags else declared.metavar
        raise typer.BadParameter(str(error), param_hint=hint) from None
