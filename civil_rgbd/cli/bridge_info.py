"""What a command that makes a bridge is told of it: where it goes, and what people say of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from civil_rgbd.cli.places import dataset_option
from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    from civil_rgbd.domain.bridge import BridgeInfo

_OPTIONS: Final = (
    dataset_option("The dataset folder; the bridge goes to bridges/ID in it."),
    click.option(
        "--bridge-info",
        "bridge_info",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="TOML: name, place, structure, licence, citation of the bridge.",
    ),
    click.option("--licence", metavar="SPDX", help="Licence of the data, for example CC-BY-4.0."),
)


def options_of_bridge(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options; :func:`read_bridge_info` turns what they give into a noun."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def read_bridge_info(
    path: Path | None, *, licence: str | None, otherwise: BridgeInfo
) -> BridgeInfo:
    """Read what people say of a bridge.

    Args:
        path: the TOML file of ``--bridge-info``, if any.
        licence: of ``--licence``; goes before the file's.
        otherwise: what holds without a file; its id holds with one too.

    Raises:
        UsageError: the licence is no SPDX expression.
        FormatError: the file does not fit its schema.
    """
    from civil_rgbd.format.bridge_info import bridge_info_from_toml

    info = bridge_info_from_toml(path, otherwise.bridge_id) if path else otherwise
    try:
        return replace(info, licence=licence) if licence else info
    except ValueError as error:
        raise UsageError(
            str(error), where="--licence", fix="see https://spdx.org/licenses for the names"
        ) from error
