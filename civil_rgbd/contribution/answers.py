"""A contributor's answers: from a manifest, from ``bridge.toml``, and laid over each other."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from civil_rgbd.contribution.questions import QUESTIONS
from civil_rgbd.domain.bridge import UNSTATED_LICENCE, BridgeInfo
from civil_rgbd.errors import UsageError
from civil_rgbd.format.bridge_info import (
    bridge_info_from_toml,
    info_from_document,
    info_to_document,
)
from civil_rgbd.format.documents import write_text
from civil_rgbd.format.versions import Document

Answers = dict[str, object]
"""By dotted key of ``bridge.toml``; a key that nobody answered is absent."""

_HEAD = "# What is known of the bridge: for `build --bridge-info` and `new-bridge --from`.\n"


def answers_of(info: BridgeInfo) -> Answers:
    """Return what is said of a bridge by dotted key; a licence that is not stated is no answer."""
    document = info_to_document(info)
    del document["bridge_id"]
    if info.licence == UNSTATED_LICENCE:
        del document["licence"]
    answers: Answers = {}
    for key, value in document.items():
        if key != "location" and isinstance(value, dict):
            answers |= {f"{key}.{k}": v for k, v in value.items() if v is not None}
        elif key == "location" and value is not None:
            answers[key] = {k: v for k, v in value.items() if v is not None}
        elif value not in (None, []):
            answers[key] = value
    return answers


def info_of(answers: Answers, bridge_id: str) -> BridgeInfo:
    """Return what the answers say of a bridge: the inverse of :func:`answers_of`."""
    return info_from_document({"bridge_id": bridge_id, **_nested(answers)})


def _nested(answers: Answers) -> Document:
    document: Document = {}
    for key, value in answers.items():
        table, _, name = key.rpartition(".")
        (document.setdefault(table, {}) if table else document)[name] = value
    return document


def read_answers(path: Path, bridge_id: str) -> Answers:
    """Read answers from a ``bridge.toml``.

    Raises:
        UsageError: the file is missing, is no TOML, breaks its schema, or holds a licence, a code
            or a date that is none.
    """
    answers = answers_of(bridge_info_from_toml(path, bridge_id))
    for question in QUESTIONS:
        value = answers.get(question.key)
        typed = ", ".join(value) if isinstance(value, list) else value
        if isinstance(typed, str):
            try:
                answers[question.key] = question.parse(typed)
            except ValueError as error:
                raise UsageError(
                    str(error),
                    where=f"{path}: {question.key}",
                    fix="docs/format.md has the words and codes of bridge.toml",
                ) from error
    return answers


def write_answers(path: Path, answers: Answers) -> None:
    """Write answers as a ``bridge.toml``, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, _HEAD + "".join(f"{line}\n" for line in _toml_lines(_nested(answers))))


def _toml_lines(document: Document) -> Iterator[str]:
    tables = {key: value for key, value in document.items() if isinstance(value, dict)}
    for key, value in document.items():
        if key not in tables:
            yield f"{key} = {_toml(value)}"
    for table, values in tables.items():
        yield ""
        yield f"[{table}]"
        for key, value in values.items():
            yield f"{key} = {_toml(value)}"


def _toml(value: object) -> str:
    # A JSON string, number or list of strings is TOML as well, but for DEL, which TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
