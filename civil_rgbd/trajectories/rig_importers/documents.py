"""A calibration file as it lies on disk: JSON, YAML, OpenCV's YAML, or a bare matrix."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from civil_rgbd.errors import MissingExtraError, UsageError

_LARGEST_BYTES: Final = 1 << 20  # the longest calibration seen is 20 kB


@dataclass(frozen=True, slots=True)
class Document:
    """One parsed file.

    Attributes:
        path: where it came from.
        data: mappings, lists and scalars; of a bare matrix its rows of numbers.
    """

    path: Path
    data: Any

    @property
    def table(self) -> dict[str, Any]:
        """The outermost mapping, without ROS 2's ``/node: ros__parameters:`` around it."""
        table = self.data if isinstance(self.data, dict) else {}
        while len(table) == 1:
            (inner,) = table.values()
            if not isinstance(inner, dict) or "ros__parameters" not in (*table, *inner):
                break
            table = inner
        return {str(key): value for key, value in table.items()}

    @property
    def is_matrix(self) -> bool:
        """Whether it holds nothing but rows of numbers."""
        return isinstance(self.data, list) and all(isinstance(row, tuple) for row in self.data)


def read_document(path: Path) -> Document:
    """Read a calibration file.

    Raises:
        UsageError: it is not there, too large, or in none of these notations.
        MissingExtraError: it is YAML and PyYAML is not installed.
    """
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise UsageError(
                f"the calibration has {path.stat().st_size} bytes, more than {_LARGEST_BYTES}",
                where=path,
                fix="give the calibration's file, not the data it was made from",
            )
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UsageError(
            f"the calibration cannot be read: {error.strerror}", where=path, fix="check the path"
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"the calibration is no text: {error}", where=path, fix="give a text file"
        ) from error
    return Document(path, _parsed(text, path))


def _parsed(text: str, path: Path) -> Any:  # noqa: ANN401  # foreign data is typed by who reads it
    rows = _rows_of_numbers(text)
    if rows:
        return rows
    if text.lstrip().startswith("{"):
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise UsageError(
                f"the calibration is not JSON: {error}", where=path, fix="check the file"
            ) from error
    return _yaml(text, path)


def _rows_of_numbers(text: str) -> list[tuple[float, ...]]:
    """Rows of numbers between commas, semicolons or blanks; empty for anything else."""
    rows = []
    for line in text.splitlines():
        words = line.replace(",", " ").replace(";", " ").strip("[] \t").split()
        if not words or line.lstrip().startswith("#"):
            continue
        try:
            rows.append(tuple(float(word) for word in words))
        except ValueError:
            return []
    return rows


def _yaml(text: str, path: Path) -> Any:  # noqa: ANN401  # foreign data is typed by who reads it
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError(
            "reading YAML calibrations needs PyYAML",
            where=path,
            fix='pip install "civil-rgbd[rig]"',
        ) from error

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # no stubs: its base is Any
        """Takes tags such as OpenCV's ``!!opencv-matrix`` for what they stand on."""

    Loader.add_multi_constructor("", _untagged)
    # OpenCV writes "%YAML:1.0", which is no YAML directive.
    plain = "\n".join("" if line.startswith("%YAML") else line for line in text.splitlines())
    try:
        return next(iter(yaml.load_all(plain, Loader=Loader)), None)  # it is a SafeLoader
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        said = " ".join(str(error).split())
        raise UsageError(
            f"the calibration is neither YAML, JSON nor a matrix: {said}",
            where=path,
            fix="check the file; tabs may not indent YAML",
        ) from error


def _untagged(loader: Any, tag: str, node: Any) -> Any:  # noqa: ANN401  # PyYAML is not typed
    del tag
    kind = node.id
    if kind == "mapping":
        return loader.construct_mapping(node, deep=True)
    if kind == "sequence":
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


def tables_within(table: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Give a mapping and those directly and indirectly inside it, outermost first."""
    waiting = [table]
    for _ in range(1000):  # aliases can make a mapping contain itself
        if not waiting:
            return
        here = waiting.pop(0)
        yield here
        waiting += [
            {str(key): value for key, value in inner.items()}
            for inner in here.values()
            if isinstance(inner, dict)
        ]


def table_with(documents: list[Document], *keys: str) -> tuple[Document, dict[str, Any]] | None:
    """Find the first mapping of any document that has all of the keys."""
    for document in documents:
        for table in tables_within(document.table):
            if all(key in table for key in keys):
                return document, table
    return None
