"""Options that say where a build runs; none of them changes a byte of what comes out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import click

from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    from civil_rgbd.builder.run import BuildOptions

_OPTIONS: Final = (
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        metavar="N",
        help="Chunks at once  [default: one a processor, or a thread of the cluster]",
    ),
    click.option(
        "--executor",
        type=click.Choice(["serial", "processes", "dask"]),
        help="Where chunks run  [default: processes; dask with --scheduler]",
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="A running Dask scheduler, tcp://host:8786, or the JSON file that it wrote.",
    ),
    click.option(
        "--chunk",
        metavar="I/N",
        help="Make the I-th of N parts and publish nothing: for job arrays, I from 1. "
        "`civil-rgbd finish` joins the parts.",
    ),
)


def options_of_execution(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options; :func:`options_from` turns what they give into nouns."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def options_from(
    *, workers: int | None, executor: str | None, scheduler: str | None, chunk: str | None
) -> BuildOptions:
    """Say where a build runs.

    Raises:
        UsageError: options contradict each other.
    """
    from civil_rgbd.builder.run import BuildOptions
    from civil_rgbd.builder.shares import share_from

    if scheduler is not None:
        if not scheduler:
            raise UsageError(
                "the scheduler's address is empty",
                where="--scheduler",
                fix="give tcp://HOST:8786 or the scheduler's JSON file: is a variable not set?",
            )
        executor = executor or "dask"
    if scheduler is not None and executor != "dask":
        raise UsageError(
            f"--scheduler is the address of a Dask cluster, but --executor is {executor}",
            where="--executor",
            fix="leave one of them out",
        )
    if chunk is not None and executor == "dask":
        raise UsageError(
            "--chunk makes one part of a build here, a Dask cluster makes all of it",
            where="--chunk",
            fix="leave --chunk out, or --executor dask and --scheduler",
        )
    if executor == "serial" and (workers or 1) > 1:
        raise UsageError(
            f"--executor serial makes one chunk at a time, but --workers is {workers}",
            where="--workers",
            fix="leave one of them out",
        )
    return BuildOptions(
        workers=1 if executor == "serial" else workers,
        executor=executor,
        scheduler=scheduler,
        share=None if chunk is None else share_from(chunk),
    )
