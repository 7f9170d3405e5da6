"""The registry: which bridges are accepted, and where their archives lie."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.format.datasets import refuse_same_ids
from civil_rgbd.format.documents import (
    check_document,
    document_from_text,
    document_text,
    read_document,
)
from civil_rgbd.format.versions import Document, current_document
from civil_rgbd.resources import nearest

KIND = "registry"


@dataclass(frozen=True, slots=True)
class RegistryEntry:
    """One accepted bridge.

    Attributes:
        id: the bridge's id.
        version: ``data_version`` of its manifest.
        where: address of its archive.
        sha256: of the archive, lower-case hex.
        size_bytes: length of the archive.
        licence: SPDX id of the data's licence.
    """

    id: str
    version: str
    where: str
    sha256: str
    size_bytes: int
    licence: str


def shipped_registry() -> tuple[RegistryEntry, ...]:
    """Return the registry that ships with this release."""
    text = resources.files("civil_rgbd.registry").joinpath("bridges.json").read_text("utf-8")
    return registry_from_text(text, where="registry/bridges.json")


def read_registry(path: Path) -> tuple[RegistryEntry, ...]:
    """Read a registry from a file.

    Raises:
        FormatError: the file is missing, damaged, or breaks its schema.
    """
    return registry_from_document(read_document(path), where=path)


def registry_from_text(text: str, *, where: object) -> tuple[RegistryEntry, ...]:
    """Turn the text of a registry into its entries.

    Raises:
        FormatError: it is no JSON, or breaks its schema.
    """
    return registry_from_document(document_from_text(text, where=where), where=where)


def registry_from_document(document: Document, *, where: object) -> tuple[RegistryEntry, ...]:
    """Turn a parsed registry into its entries.

    Raises:
        FormatError: it breaks its schema, or lists a bridge twice.
    """
    document = current_document(document, kind=KIND, where=where)
    check_document(document, kind=KIND, where=where)
    entries = tuple(RegistryEntry(**entry) for entry in document["bridges"])
    ids = [entry.id for entry in entries]
    twice = sorted({bridge for bridge in ids if ids.count(bridge) > 1})
    if twice:
        raise FormatError(
            f"the registry lists {twice[0]!r} twice", where=where, fix="keep the newer entry"
        )
    refuse_same_ids(ids, where=where)
    return entries


def find_entry(
    entries: tuple[RegistryEntry, ...], bridge_id: str, *, where: object
) -> RegistryEntry:
    """Return the entry of a bridge.

    Raises:
        UsageError: the registry does not list it.
    """
    known = {entry.id: entry for entry in entries}
    if bridge_id in known:
        return known[bridge_id]
    raise UsageError(
        f"the registry lists no bridge {bridge_id!r}",
        where=where,
        fix=nearest(bridge_id, known)
        if known
        else "it lists none yet; --registry FILE|URL reads another",
    )


def entry_text(entry: RegistryEntry) -> str:
    """Return an entry as the registry holds it, for a maintainer to paste."""
    return document_text(
        {
            "id": entry.id,
            "version": entry.version,
            "where": entry.where,
            "sha256": entry.sha256,
            "size_bytes": entry.size_bytes,
            "licence": entry.licence,
        }
    )


def registry_to_document(entries: tuple[RegistryEntry, ...]) -> Document:
    """Return the document that :func:`registry_from_document` reads."""
    return {
        "format_version": FORMAT_VERSION,
        "bridges": [document_from_text(entry_text(entry), where=entry.id) for entry in entries],
    }
