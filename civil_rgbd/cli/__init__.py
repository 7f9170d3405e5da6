"""The command line: one file a command; parse, one library call, print."""

from __future__ import annotations

import importlib
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Final

import click

from civil_rgbd.errors import BridgeFailedError, CivilRgbdError
from civil_rgbd.resources import nearest

COMMANDS: Final = {
    "benchmark": "Train with one bridge left out, and tabulate the errors on it.",
    "build": "Build a bridge folder from a raw recording.",
    "check": "Say whether a recording is fit, before leaving the site.",
    "convert": "Take over a set that others rendered, as a bridge folder.",
    "download": "Fetch an accepted bridge, verified.",
    "evaluate": "Score a trained model, or predictions on disk.",
    "export": "Write bridges in the layouts that other programs read.",
    "finish": "Join the parts of a build that were made one by one.",
    "export-onnx": "Write a trained model as ONNX, compared with torch.",
    "info": "Say what a dataset or bridge holds.",
    "inspect-recording": "Say what a raw recording holds, and what it lacks for a build.",
    "new-bridge": "Say what a contributed bridge is: place, owner, consent, licence.",
    "pack": "Pack a bridge for submission, with a report.",
    "poses": "Compute poses for a recording that has none.",
    "predict": "Predict the depth of photos.",
    "recipes": "List the recipes that ship, or print one.",
    "rig": "Import a calibration as a rig file, or check one against a recording.",
    "simulate": "Write a simulated recording.",
    "train": "Train a depth model.",
    "validate": "Check a dataset or bridge against the format.",
    "verify": "Prove a dataset or bridge: its hashes, and its frames rendered again.",
}
"""Commands and their one-line help: known without importing what they need."""


class LazyGroup(click.Group):
    """Imports a command when it is called, so that ``--help`` stays light."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command."""
        if cmd_name not in COMMANDS:
            ctx.fail(f"no such command: {cmd_name!r}; {nearest(cmd_name, COMMANDS)}")
        module = importlib.import_module(f"civil_rgbd.cli.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="civil-rgbd", prog_name="civil-rgbd")
def group() -> None:
    """LiDAR RGB-D data of civil structures: build, check, look."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: without the program's name; None takes them from the process.

    Returns:
        0 done; 1 ran, but findings or a failed bridge; 2 bad input, usage or environment;
        130 interrupted.
    """
    warnings.showwarning = _say_warning
    try:
        result = group.main(
            args=None if arguments is None else list(arguments),
            prog_name="civil-rgbd",
            standalone_mode=False,
        )
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  # each has its exit code
        return _exit_code(error)
    return result if isinstance(result, int) else 0


def _exit_code(error: BaseException) -> int:
    """Say what went wrong, and return what the shell is told."""
    match error:
        case CivilRgbdError():
            click.echo(f"error: {error}", err=True)
            return 1 if isinstance(error, BridgeFailedError) else 2
        case click.exceptions.Exit():
            return error.exit_code
        case KeyboardInterrupt() | click.Abort():
            click.echo("interrupted", err=True)
            return 130
        case BrokenPipeError():
            sys.stderr.close()  # the reader of our output went away: nothing is left to say
            return 0
        case click.ClickException():
            error.show()
        case _:
            click.echo("".join(traceback.format_exception(error)), err=True, nl=False)
            click.echo("this is a fault of civil_rgbd: please report it with these lines", err=True)
    return 2


def _say_warning(message: Warning | str, *_where: object, **_more: object) -> None:
    click.echo(f"warning: {message}", err=True)
