"""Surveys: many recordings in one file, each with what the command line could say of it."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from civil_rgbd.errors import UsageError
from civil_rgbd.format.documents import counted_faults, schema_faults
from civil_rgbd.resources import load_schema, nearest
from civil_rgbd.storage.places import is_remote, place_of

_FILES: Final = (
    "bridge_info",
    "rig",
    "trajectory",
    "trajectory_times",
    "images",
    "image_times",
    "scan_times",
)
"""Keys that name a file or folder."""

_OF_BRIDGE: Final = ("id", "source", "sha256", "licence", "bridge_info", "rig")
"""Keys that are fields of :class:`SurveyEntry`; the others say how the recording is read."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyEntry:
    """One bridge of a survey.

    Attributes:
        bridge_id: unique in the survey, ignoring case.
        sources: paths or addresses of the recording's files, in order.
        sha256: of the files, in order; () when nobody wrote them down.
        licence: SPDX expression, if it says one.
        bridge_info: file with the bridge's description, if any.
        rig: rig file, if any.
        reading: how the recording is read: values by the names of the command line's options,
            None and False where nothing is said.
    """

    bridge_id: str
    sources: tuple[str, ...]
    sha256: tuple[str, ...]
    licence: str | None
    bridge_info: Path | None
    rig: Path | None
    reading: Mapping[str, Any]


def read_survey(path: Path) -> tuple[SurveyEntry, ...]:
    """Read a ``survey.toml``, and look whether the files that it names are there.

    Args:
        path: the file; paths in it are relative to its folder.

    Raises:
        UsageError: the file is missing, no TOML or on object storage, a key is unknown or does not
            fit, two bridges have one id, files are missing (all of them are listed), or a bridge
            has more or fewer hashes than files.
    """
    url = place_of(path)
    if is_remote(url):
        raise UsageError(
            "the survey lies on object storage: it is read from this machine",
            where=url,
            fix=f"fetch it: `aws s3 cp {url} .`; the recordings that it names may stay there, by "
            "their URLs",
        )
    try:
        document = tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise UsageError(
            f"the survey cannot be read: {error.strerror}", where=path, fix="check the path"
        ) from error
    except ValueError as error:
        raise UsageError(
            f"this is no TOML: {error}", where=path, fix="mend the line it names"
        ) from error
    _refuse_unknown(document, path)
    faults = schema_faults(document, kind="survey")
    if faults:
        listing = "".join(f"\n    {place}: {words}" for place, words in faults)
        raise UsageError(
            f"the survey has {counted_faults(faults)}:{listing}",
            where=path,
            fix="docs/format.md explains every key of survey.toml",
        )
    _refuse_same_ids([bridge["id"] for bridge in document["bridge"]], path)
    defaults = document.get("defaults", {})
    entries = tuple(_entry({**defaults, **one}, path.parent) for one in document["bridge"])
    _refuse_missing(entries, path)
    _refuse_odd_hashes(entries, path)
    return entries


def _refuse_unknown(document: Mapping[str, Any], where: Path) -> None:
    top = load_schema("survey")["properties"]
    tables: list[tuple[str, Any, Mapping[str, Any]]] = [("the survey", document, top)]
    tables.append(("[defaults]", document.get("defaults"), top["defaults"]["properties"]))
    bridges = document.get("bridge")
    for number, one in enumerate(bridges if isinstance(bridges, list) else (), 1):
        name = one.get("id", f"number {number}") if isinstance(one, dict) else number
        tables.append((f"bridge {name!r}", one, top["bridge"]["items"]["properties"]))
    for name, table, known in tables:
        for key in table if isinstance(table, dict) else ():
            if key not in known:
                raise UsageError(f"{name} has no key {key!r}", where=where, fix=nearest(key, known))


def _refuse_same_ids(ids: list[str], where: Path) -> None:
    counts = Counter(bridge_id.lower() for bridge_id in ids)
    twice = [bridge_id for bridge_id in ids if counts[bridge_id.lower()] > 1]
    if twice:
        raise UsageError(
            f"bridges have the same id, ignoring case: {', '.join(map(repr, twice))}",
            where=where,
            fix="give each bridge an id of its own",
        )


def _entry(values: Mapping[str, Any], folder: Path) -> SurveyEntry:
    paths = {key: folder / values[key] for key in _FILES if key in values}
    known = load_schema("survey")["properties"]["bridge"]["items"]["properties"]
    reading = {
        key: paths.get(key, values.get(key, False if schema["type"] == "boolean" else None))
        for key, schema in known.items()
        if key not in _OF_BRIDGE
    }
    if reading["trajectory_offset"] is not None:
        reading["trajectory_offset"] = str(reading["trajectory_offset"])
    return SurveyEntry(
        bridge_id=values["id"],
        sources=tuple(_located(source, folder) for source in _listed(values["source"])),
        sha256=tuple(_listed(values.get("sha256", []))),
        licence=values.get("licence"),
        bridge_info=paths.get("bridge_info"),
        rig=paths.get("rig"),
        reading=reading,
    )


def _listed(value: str | list[str]) -> list[str]:
    return [value] if isinstance(value, str) else value


def _located(source: str, folder: Path) -> str:
    return source if is_address(source) else str(folder / source)


def is_address(source: str) -> bool:
    """Tell whether a source is no path of this machine: ``s3://...``, ``simulated:demo``.

    >>> is_address("s3://raw/park.mcap"), is_address("raw/park.mcap"), is_address("C:/park.mcap")
    (True, False, False)
    """
    head, colon, _ = source.partition(":")
    return bool(colon) and len(head) > 1 and head.replace("+", "").isalnum()


def _refuse_missing(entries: tuple[SurveyEntry, ...], where: Path) -> None:
    missing = [
        f"\n    {entry.bridge_id}: {key} {path}"
        for entry in entries
        for key, path in _paths(entry)
        if not path.exists()
    ]
    if missing:
        raise UsageError(
            f"the survey names what is not there ({len(missing)}):{''.join(missing)}",
            where=where,
            fix=f"paths are relative to {where.absolute().parent}: mend them, or fetch the files",
        )


def _refuse_odd_hashes(entries: tuple[SurveyEntry, ...], where: Path) -> None:
    for entry in entries:
        files, hashes = len(entry.sources), len(entry.sha256)
        if hashes not in {0, files} and all(map(_is_one_file, entry.sources)):
            raise UsageError(
                f"bridge {entry.bridge_id!r} has sources: {files}, but sha256: {hashes}",
                where=where,
                fix="write one sha256 for each source, in the same order; or none at all",
            )


def _is_one_file(source: str) -> bool:
    """Tell whether a source is one file, as far as is known without asking; folders hold many."""
    return source.lower().endswith((".mcap", ".bag")) or Path(source).is_file()


def _paths(entry: SurveyEntry) -> Iterator[tuple[str, Path]]:
    for source in entry.sources:
        if not is_address(source):
            yield "source", Path(source)
    for key in _FILES:
        path = entry.reading[key] if key in entry.reading else getattr(entry, key)
        if path is not None:
            yield key, path
