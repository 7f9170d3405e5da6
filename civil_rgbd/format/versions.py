"""Which versions of the format can be read, and how.

A document of an older minor is a valid document of ours: minors only add optional keys. One of a
newer minor may hold keys that we do not know: they are left out with one warning. One of an older
major is migrated. One of a newer major is refused.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.errors import FormatError
from civil_rgbd.resources import load_schema

Document = dict[str, Any]
Migration = Callable[[Document], Document]

MIGRATIONS: dict[tuple[str, int], Migration] = {}
"""By kind of document and major: makes a document of that major one of the next. None yet."""


class FormatVersionWarning(UserWarning):
    """A file of a newer minor version holds keys that this release does not know."""


def parse_version(version: object, *, where: object) -> tuple[int, int]:
    """Split ``major.minor``.

    Raises:
        FormatError: it is no version.

    >>> parse_version("1.0", where="manifest.json")
    (1, 0)
    """
    match = (
        re.fullmatch(r"([0-9]{1,6})\.([0-9]{1,6})", version) if isinstance(version, str) else None
    )
    if not match:
        raise FormatError(
            f"format_version is {version!r}, not major.minor such as {FORMAT_VERSION!r}",
            where=where,
            fix="this is not a file of a civil_rgbd dataset, or it is damaged",
        )
    return int(match[1]), int(match[2])


def current_document(document: Document, *, kind: str, where: object) -> Document:
    """Bring a document of any version that can be read to the shape of this release's version.

    Args:
        document: a parsed file.
        kind: the schema's name: ``manifest``, ``poses``, ...
        where: the file, for messages.

    Returns:
        a document to check strictly against this release's schema.

    Raises:
        FormatError: its major is newer than ours, or nothing leads up from it.
    """
    ours = parse_version(FORMAT_VERSION, where="civil_rgbd.constants")
    theirs = parse_version(document.get("format_version"), where=where)
    if theirs[0] > ours[0]:
        raise FormatError(
            f"format version {theirs[0]}.{theirs[1]} is newer than {FORMAT_VERSION}, "
            "the newest that this release reads",
            where=where,
            fix="install a newer civil-rgbd: `pip install --upgrade civil-rgbd`",
        )
    for major in range(theirs[0], ours[0]):
        if (kind, major) not in MIGRATIONS:
            raise FormatError(
                f"nothing leads from format version {theirs[0]}.{theirs[1]} to {FORMAT_VERSION}",
                where=where,
                fix="build the bridge again with this release",
            )
        document = MIGRATIONS[kind, major](document)
    if theirs[0] == ours[0] and theirs[1] > ours[1]:
        return without_unknown_keys(document, kind=kind, where=where)
    return document


def without_unknown_keys(document: Document, *, kind: str, where: object) -> Document:
    """Leave out the keys that our schema does not know, with one warning that names them."""
    unknown: dict[str, None] = {}
    known: Document = _pruned(document, load_schema(kind), "", unknown)
    if unknown:
        warnings.warn(
            f"{where} follows format {document.get('format_version')}, newer than "
            f"{FORMAT_VERSION}: ignored {', '.join(unknown)}",
            FormatVersionWarning,
            stacklevel=2,
        )
    return known


def _pruned(value: Any, schema: Document, path: str, unknown: dict[str, None]) -> Any:  # noqa: ANN401  # JSON
    if isinstance(value, list):
        items = schema.get("items", {})
        return [_pruned(item, items, f"{path}[]", unknown) for item in value]
    if not isinstance(value, dict) or schema.get("type") in (None, "array"):
        return value
    return dict(_known_items(value, schema, path, unknown))


def _known_items(
    value: Document, schema: Document, path: str, unknown: dict[str, None]
) -> Iterator[tuple[str, Any]]:
    properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    for key, item in value.items():
        place = f"{path}.{key}" if path else key
        if key not in properties and others is False:
            unknown[place] = None
        else:
            inner = properties.get(key, others if isinstance(others, dict) else {})
            yield key, _pruned(item, inner, place, unknown)
