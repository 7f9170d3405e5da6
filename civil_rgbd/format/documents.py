"""JSON documents: read strictly, checked against their schema, written the same way every time."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sized
from functools import cache
from typing import Any, Final

import jsonschema

from civil_rgbd.errors import FormatError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.versions import Document
from civil_rgbd.resources import load_schema
from civil_rgbd.storage.places import Place

_SHOWN_FAULTS: Final = 20
_VALUE_LETTERS: Final = 60
_VECTOR: Final = re.compile(r"\[\n\s+((?:-?[0-9][-+.eE0-9]*,?\s+)+)\]")


def read_document(path: Place) -> Document:
    """Read a JSON file that holds one object.

    Stricter than the standard library: a key that comes twice and a number that is not finite
    have no one meaning, and are refused.

    Raises:
        FormatError: the file is missing, or holds something else.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError as error:
        raise FormatError(
            "the file is missing",
            where=path,
            fix="build or download the folder again: a whole one has this file",
        ) from error
    except OSError as error:
        raise FormatError(
            f"the file cannot be read: {error.strerror}", where=path, fix="check its permissions"
        ) from error
    except UnicodeDecodeError as error:
        raise _no_json(path, f"it is not UTF-8 ({error.reason} at byte {error.start})") from error
    return document_from_text(text, where=path)


def document_from_text(text: str, *, where: object) -> Document:
    """Parse the text of a JSON file that holds one object.

    Raises:
        FormatError: it holds something else.
    """
    try:
        document = json.loads(
            text,
            object_pairs_hook=_unique_keys,
            parse_constant=_finite,
            parse_float=_finite,
        )
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deep" if isinstance(error, RecursionError) else str(error)
        raise _no_json(where, reason) from error
    if not isinstance(document, dict):
        raise _no_json(where, f"it holds {type(document).__name__}, not an object")
    return document


def _no_json(where: object, reason: str) -> FormatError:
    return FormatError(
        f"this is not a whole JSON document: {reason}",
        where=where,
        fix="restore the file from a backup, or build or download the folder again",
    )


def _unique_keys(pairs: list[tuple[str, Any]]) -> Document:
    document = dict(pairs)
    if len(document) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"key {twice!r} comes twice")
    return document


def _finite(number: str) -> float:
    value = float(number)
    if not math.isfinite(value):
        raise ValueError(f"{number} is not a finite number")
    return value


@cache
def _validator(kind: str) -> Any:  # noqa: ANN401  # jsonschema publishes no stubs
    return jsonschema.Draft202012Validator(load_schema(kind))


def schema_faults(document: Document, *, kind: str) -> list[tuple[str, str]]:
    """Return all places where a document breaks its schema.

    Args:
        document: of this release's version.
        kind: the schema's name.

    Returns:
        (JSON path, what is wrong there) each, ordered by path.
    """
    faults = ((error.json_path, _words(error)) for error in _validator(kind).iter_errors(document))
    return sorted(faults)


def _words(error: Any) -> str:  # noqa: ANN401  # jsonschema publishes no stubs
    # jsonschema puts the whole value in front, and a value may be a whole file.
    message = str(error.message)
    value = repr(error.instance)
    if len(value) > _VALUE_LETTERS and message.startswith(value):
        return value[:_VALUE_LETTERS] + "..." + message[len(value) :]
    return message


def check_document(document: Document, *, kind: str, where: object) -> None:
    """Refuse a document that breaks its schema.

    Raises:
        FormatError: it does; every fault is listed with its JSON path.
    """
    refuse_faults(
        (f"{path}: {words}" for path, words in schema_faults(document, kind=kind)),
        kind=kind,
        where=where,
    )


def refuse_faults(faults: Iterable[str], *, kind: str, where: object) -> None:
    """Raise one FormatError that lists the faults; nothing when there is none."""
    lines = list(faults)
    if not lines:
        return
    more = [f"and {len(lines) - _SHOWN_FAULTS} more"] if len(lines) > _SHOWN_FAULTS else []
    listing = "".join(f"\n    {line}" for line in lines[:_SHOWN_FAULTS] + more)
    raise FormatError(
        f"{counted_faults(lines)} against schema/{kind}.schema.json:{listing}",
        where=where,
        fix="mend these places; docs/format.md explains every key",
    )


def write_document(path: Place, document: Document, *, kind: str) -> None:
    """Write a JSON file, whole or not at all; the same document gives the same bytes.

    Args:
        path: the file to make; its folder exists.
        document: keys in the order that the file shall have.
        kind: its schema.

    Raises:
        FormatError: the document breaks its own schema; nothing is written.
        OutputError: the file cannot be written.
    """
    check_document(document, kind=kind, where=path)
    write_text(path, document_text(document))


def document_text(document: Document) -> str:
    """Return the text of a JSON file: indented by two, a line feed at the end.

    >>> print(document_text({"map_up": [0.0, 0.0, 1.0]}), end="")
    {
      "map_up": [0.0, 0.0, 1.0]
    }
    """
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    # Vectors on one line. A string never matches: line feeds inside strings are escaped.
    return _VECTOR.sub(lambda match: f"[{' '.join(match[1].split())}]", text)


def write_text(path: Place, text: str) -> None:
    """Write a text file in UTF-8 with plain line feeds, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    with whole_file(path) as scratch:
        scratch.write_bytes(text.encode("utf-8"))


def counted_faults(faults: Sized) -> str:
    """Say how many faults there are.

    >>> counted_faults(["one"]), counted_faults([])
    ('1 fault', '0 faults')
    """
    return "1 fault" if len(faults) == 1 else f"{len(faults)} faults"
