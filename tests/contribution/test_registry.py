"""The registry: what ships is well-formed, and what is not is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.contribution.registry import (
    RegistryEntry,
    entry_text,
    find_entry,
    read_registry,
    registry_to_document,
    shipped_registry,
)
from civil_rgbd.errors import FormatError, UsageError

ENTRY = RegistryEntry("B1", "1.0", "https://example.org/B1.tar", "0" * 64, 10_240, "CC-BY-4.0")


def written(path: Path, **changes: Any) -> Path:
    entry = json.loads(entry_text(ENTRY)) | changes
    entry = {key: value for key, value in entry.items() if value is not None}
    path.write_text(json.dumps({"format_version": "1.0", "bridges": [entry]}))
    return path


def test_the_registry_that_ships_can_be_read() -> None:
    assert isinstance(shipped_registry(), tuple)


def test_entries_come_back(tmp_path: Path) -> None:
    path = tmp_path / "bridges.json"
    path.write_text(json.dumps(registry_to_document((ENTRY,))))

    assert read_registry(path) == (ENTRY,)
    assert read_registry(written(path)) == (ENTRY,)


@pytest.mark.parametrize(
    "changes",
    [
        {"id": "../B1"},
        {"sha256": "F" * 64},
        {"sha256": "0" * 63},
        {"size_bytes": 0},
        {"size_bytes": "10240"},
        {"where": "file:///etc/passwd"},
        {"where": "ftp://example.org/B1.tar"},
        {"licence": None},
        {"mirror": "https://example.com"},
    ],
)
def test_an_entry_that_breaks_the_schema_is_refused(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    with pytest.raises(FormatError, match=r"schema/registry\.schema\.json"):
        read_registry(written(tmp_path / "bridges.json", **changes))


@pytest.mark.parametrize(("other", "words"), [("B1", "'B1' twice"), ("b1", "case of letters")])
def test_a_bridge_is_listed_once(tmp_path: Path, other: str, words: str) -> None:
    document = registry_to_document((ENTRY, ENTRY))
    document["bridges"][1]["id"] = other
    (tmp_path / "bridges.json").write_text(json.dumps(document))

    with pytest.raises(FormatError, match=words):
        read_registry(tmp_path / "bridges.json")


def test_an_unknown_id_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="lists no bridge 'B2'") as caught:
        find_entry((ENTRY,), "B2", where="bridges.json")

    assert caught.value.fix == "did you mean 'B1'? Known: B1"


def test_an_empty_registry_says_so() -> None:
    with pytest.raises(UsageError, match="lists none yet"):
        find_entry((), "B2", where="bridges.json")
