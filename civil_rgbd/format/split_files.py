"""Split files: JSON, whole or absent."""

from __future__ import annotations

import json
from pathlib import Path

from civil_rgbd.domain.split import Split, split_from_document
from civil_rgbd.format.documents import read_document, write_text


def read_split(path: Path) -> Split:
    """Read a split file.

    Raises:
        FormatError: the file is missing, damaged, or no split.
    """
    return split_from_document(read_document(path), where=path)


def write_split(path: Path, split: Split) -> None:
    """Write a split file; the same split gives the same bytes.

    Args:
        path: the file to make; its folder exists.
        split: what to write.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, json.dumps(split.to_document(), indent=1, ensure_ascii=False) + "\n")
