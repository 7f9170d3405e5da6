"""``defects.json``: defects that were marked in the frames. Optional."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.domain.defect import DefectMeasure, DefectRecord
from civil_rgbd.format.documents import check_document, read_document, write_document
from civil_rgbd.format.versions import Document, current_document
from civil_rgbd.storage.places import Place

KIND: Final = "defects"


def read_defects(path: Place) -> tuple[DefectRecord, ...]:
    """Read ``defects.json``; () where there is none.

    Raises:
        FormatError: the file is damaged or breaks its schema.
    """
    return defects_from_document(read_document(path), where=path) if path.exists() else ()


def defects_from_document(document: Document, *, where: object) -> tuple[DefectRecord, ...]:
    """Turn a parsed ``defects.json`` into defects.

    Raises:
        FormatError: it breaks its schema.
    """
    document = current_document(document, kind=KIND, where=where)
    check_document(document, kind=KIND, where=where)
    return tuple(_defect_from(values) for values in document["defects"])


def _defect_from(values: Document) -> DefectRecord:
    points = tuple((float(u), float(v)) for u, v in values["uv_px"])
    measures = tuple(DefectMeasure(**measure) for measure in values["measures"])
    return DefectRecord(**{**values, "uv_px": points, "measures": measures})


def defects_to_document(defects: Sequence[DefectRecord]) -> Document:
    """Turn defects into the document that :func:`defects_from_document` reads."""
    documents = []
    for defect in defects:
        document = dataclasses.asdict(defect)
        document["uv_px"] = [list(point) for point in defect.uv_px]
        document["measures"] = list(document["measures"])
        documents.append(document)
    return {"format_version": FORMAT_VERSION, "defects": documents}


def write_defects(path: Place, defects: Sequence[DefectRecord]) -> None:
    """Write ``defects.json``, whole or not at all.

    Raises:
        FormatError: a defect breaks the schema; nothing is written.
        OutputError: the file cannot be written.
    """
    write_document(path, defects_to_document(defects), kind=KIND)
