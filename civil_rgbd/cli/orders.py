"""From what the command line or a survey says of recordings to orders for bridges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from civil_rgbd.cli.beside import read_beside
from civil_rgbd.cli.bridge_info import read_bridge_info
from civil_rgbd.cli.mounting import say_mounting
from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    from civil_rgbd.builder.bridge_build import Order
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.domain.recording import Recording

_BESIDE = ("trajectory", "trajectory_times", "images", "image_times", "scan_times")


def order_of(
    sources: Sequence[str],
    info: BridgeInfo,
    *,
    rig_path: Path | None,
    reading: Mapping[str, Any],
    sha256: Sequence[str] = (),
    said_in: Path | None = None,
) -> Order:
    """Order a bridge of one recording; what lies beside it is read now, the recording later.

    Args:
        sources: the recording, or its files in order.
        info: identity and what people say about the bridge.
        rig_path: the rig file, if any.
        reading: values of the options of :func:`civil_rgbd.cli.beside.options_of_recording`.
        sha256: of the files, where somebody wrote them down.
        said_in: the file that they are written in.

    Raises:
        UsageError: options contradict each other.
        RecordingError: a file beside the recording cannot be read.
    """
    from civil_rgbd.builder.bridge_build import Order
    from civil_rgbd.converters import open_recording
    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.storage.places import place_of
    from civil_rgbd.trajectories.rig import read_rig

    rig = read_rig(rig_path) if rig_path else RigFile()
    options = RecordingOptions(rig=rig, **read_beside(dict(reading)))
    options = replace(options, more_files=tuple(map(place_of, sources[1:])), sha256=tuple(sha256))
    beside = [reading[name] for name in _BESIDE if reading.get(name) is not None]
    files = [Path(source) for source in sources if Path(source).exists()]

    def open_now() -> Recording:
        recording = open_recording(sources[0], options)
        say_mounting(recording, rig_given=rig_path is not None)
        return recording

    return Order(info, open_now, files=(*files, *beside), sha256=tuple(sha256), said_in=said_in)


def seen_from_elsewhere(
    sources: Sequence[str], reading: Mapping[str, Any]
) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Make paths absolute: workers of a cluster run in folders of their own.

    Args:
        sources: paths or addresses.
        reading: values of options by name; paths are among them.
    """
    there = (str(Path(one).absolute()) if Path(one).exists() else one for one in sources)
    options = {
        name: value.absolute() if isinstance(value, Path) else value
        for name, value in reading.items()
    }
    return tuple(there), options


def orders_of_survey(path: Path, *, only: str | None, hashed: bool = True) -> list[Order]:
    """Order the bridges of a survey file.

    Args:
        path: the survey.
        only: the id of the one bridge that is wanted; None for all.
        hashed: take the hashes of sources that have none in the survey.

    Raises:
        UsageError: the file or something that it names does not fit.
    """
    from civil_rgbd.builder.survey import read_survey
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.resources import nearest

    entries = read_survey(path)
    ids = [entry.bridge_id for entry in entries]
    if only is not None and only not in ids:
        raise UsageError(f"the survey has no bridge {only!r}", where=path, fix=nearest(only, ids))
    return [
        order_of(
            entry.sources,
            read_bridge_info(
                entry.bridge_info, licence=entry.licence, otherwise=BridgeInfo(entry.bridge_id)
            ),
            rig_path=entry.rig,
            reading={**entry.reading, "source_hash": hashed},
            sha256=entry.sha256,
            said_in=path,
        )
        for entry in entries
        if only in {None, entry.bridge_id}
    ]


def refuse_beside_survey(context: click.Context, names: Sequence[str]) -> None:
    """Refuse options that speak of one recording beside a survey, which speaks of many.

    Raises:
        UsageError: one of them is given.
    """
    from click.core import ParameterSource

    for parameter in context.command.params:
        name = parameter.name or ""
        given = context.get_parameter_source(name) is not ParameterSource.DEFAULT
        if name in names and given:
            raise UsageError(
                f"{parameter.opts[0]} speaks of one recording, a survey of many",
                where=parameter.opts[0],
                fix="write it into the survey, for one bridge or under [defaults]: "
                f"{parameter.opts[0].lstrip('-').replace('-', '_')} = ...",
            )
