"""Where a command writes its dataset, and what of the command line may be no URL."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click


def dataset_option(words: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return ``--out``, the dataset folder, which a command takes as ``dataset``.

    Args:
        words: of its help.
    """
    return click.option(
        "--out",
        "dataset",
        type=click.Path(path_type=Path),
        default="civil_rgbd_data",
        show_default=True,
        metavar="FOLDER",
        help=words,
    )


def refuse_remote(path: Path, *, option: str) -> None:
    """Refuse a URL where a folder of this machine is needed.

    Args:
        path: as click made it of the option; it turns ``s3://`` into ``s3:/``.
        option: the option's name.

    Raises:
        UsageError: it is one.
    """
    from civil_rgbd.errors import UsageError
    from civil_rgbd.storage.places import is_remote, place_of

    place = place_of(path)
    if is_remote(place):
        raise UsageError(
            f"{place} lies on object storage; only `civil-rgbd build` writes there",
            where=option,
            fix="give a folder of this machine, and copy it afterwards: "
            f"`aws s3 sync FOLDER {place}`",
        )
