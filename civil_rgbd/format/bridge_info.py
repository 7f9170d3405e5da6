"""What people say about a bridge: ``bridge.toml``, and its place in the manifest."""

from __future__ import annotations

import dataclasses
import datetime as dt
import tomllib
from pathlib import Path
from typing import Any, Final

from civil_rgbd.domain.bridge import BridgeInfo, Contribution, Location, Structure
from civil_rgbd.errors import UsageError
from civil_rgbd.format.documents import counted_faults, schema_faults
from civil_rgbd.format.versions import Document
from civil_rgbd.resources import load_schema, nearest

_NAMED: Final = {"location": Location, "structure": Structure, "contribution": Contribution}


def bridge_info_from_toml(path: Path, bridge_id: str) -> BridgeInfo:
    """Read a ``bridge.toml``.

    Args:
        path: the file.
        bridge_id: the bridge that it speaks of.

    Returns:
        what it says; the licence is ``LicenseRef-Unstated`` where it says none.

    Raises:
        UsageError: the file is missing, is no TOML, or breaks its schema.
    """
    try:
        document = tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise UsageError(
            f"the bridge's description cannot be read: {error.strerror}",
            where=path,
            fix="check the path after --bridge-info",
        ) from error
    except ValueError as error:
        raise UsageError(
            f"this is no TOML: {error}", where=path, fix='write lines such as: name = "Park Street"'
        ) from error
    plain: Document = _without_dates(document)
    _refuse_unknown(plain, path)
    faults = schema_faults(plain, kind="bridge_info")
    if faults:
        listing = "".join(f"\n    {place}: {words}" for place, words in faults)
        raise UsageError(
            f"the bridge's description has {counted_faults(faults)}:{listing}",
            where=path,
            fix="docs/format.md explains every key of bridge.toml",
        )
    try:
        return info_from_document({"bridge_id": bridge_id, **plain})
    except ValueError as error:
        raise UsageError(str(error), where=path, fix="mend the value") from error


def _without_dates(value: Any) -> Any:  # noqa: ANN401  # TOML
    """TOML knows dates, JSON does not: ISO 8601 words instead."""
    if isinstance(value, dict):
        return {key: _without_dates(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_dates(item) for item in value]
    if isinstance(value, dt.datetime):
        return value.date().isoformat()
    return value.isoformat() if isinstance(value, dt.date | dt.time) else value


def _refuse_unknown(document: Document, where: Path) -> None:
    properties = load_schema("bridge_info")["properties"]
    for key, value in document.items():
        if key not in properties:
            raise UsageError(
                f"bridge.toml has no key {key!r}", where=where, fix=nearest(key, properties)
            )
        inner = properties[key].get("properties", {})
        for name in value if inner and isinstance(value, dict) else ():
            if name not in inner:
                raise UsageError(
                    f"[{key}] has no key {name!r}", where=where, fix=nearest(name, inner)
                )


def info_from_document(document: Document) -> BridgeInfo:
    """Turn the checked part ``bridge`` of a manifest into what people say about a bridge.

    Raises:
        ValueError: a value does not fit the noun.
    """
    values = {key: value for key, value in document.items() if value is not None}
    for key, noun in _NAMED.items():
        if key in values:
            values[key] = noun(**values[key])
    if "survey_dates" in values:
        values["survey_dates"] = tuple(values["survey_dates"])
    return BridgeInfo(**values)


def info_to_document(info: BridgeInfo) -> Document:
    """Return the part ``bridge`` of a manifest, the inverse of :func:`info_from_document`."""
    document = dataclasses.asdict(info)
    document["survey_dates"] = list(info.survey_dates)
    return document
