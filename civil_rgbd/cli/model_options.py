"""``--option KEY=VALUE``: what a model is told when it is made."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def model_options(command: Command) -> Command:
    """Add ``--option``, which may be given again, as the parameter ``options``."""
    return click.option(
        "--option",
        "options",
        multiple=True,
        metavar="KEY=VALUE",
        help="Told to the model when it is made, as width_px=384; may be given again.",
    )(command)


def parsed_options(given: tuple[str, ...]) -> dict[str, Any]:
    """Take options apart; a value is JSON, or else a word.

    Raises:
        UsageError: one has no ``=``, or a key comes twice.

    >>> parsed_options(("max_depth_m=40", "rest=crop", "focal_reference_px=null"))
    {'max_depth_m': 40, 'rest': 'crop', 'focal_reference_px': None}
    """
    from civil_rgbd.errors import UsageError

    options: dict[str, Any] = {}
    for one in given:
        key, equals, value = one.partition("=")
        if not (key and equals) or key in options:
            raise UsageError(
                f"{one!r} is given twice" if key in options else f"{one!r} is no KEY=VALUE",
                where="--option",
                fix="write one --option width_px=384 for each key",
            )
        try:
            options[key] = json.loads(value)
        except ValueError:
            options[key] = value
    return options
