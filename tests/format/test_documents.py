"""JSON with one meaning, written one way."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.documents import (
    check_document,
    document_from_text,
    document_text,
    read_document,
    write_document,
)

INTRINSICS = {
    "format_version": "1.0",
    "model": "pinhole",
    "width_px": 4,
    "height_px": 3,
    "fx_px": 2.0,
    "fy_px": 2.0,
    "cx_px": 1.5,
    "cy_px": 1.0,
}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "a": 2}', "key 'a' comes twice"),
        ('{"a": NaN}', "NaN is not a finite number"),
        ('{"a": -Infinity}', "-Infinity is not a finite number"),
        ('{"a": 1e999}', "1e999 is not a finite number"),
        ("[1]", "it holds list, not an object"),
        ("[" * 100_000, "nested too deep"),
        ('{"a": 1', "Expecting ',' delimiter"),
        ("", "Expecting value"),
    ],
)
def test_text_without_one_meaning_is_refused(text: str, words: str) -> None:
    with pytest.raises(FormatError, match="not a whole JSON document") as caught:
        document_from_text(text, where="a.json")

    assert words in caught.value.what
    assert caught.value.where == "a.json"


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'{"a": "\xff"}')

    with pytest.raises(FormatError, match="it is not UTF-8"):
        read_document(tmp_path / "a.json")
    with pytest.raises(FormatError, match="the file is missing"):
        read_document(tmp_path / "b.json")
    with pytest.raises(FormatError, match="cannot be read"):
        read_document(tmp_path)


def test_all_faults_are_listed_with_their_path() -> None:
    document = {**INTRINSICS, "fx_px": -1, "cx_px": "wide", "extra": 1}
    del document["height_px"]

    with pytest.raises(FormatError, match=r"4 faults against schema/intrinsics") as caught:
        check_document(document, kind="intrinsics", where="intrinsics.json")

    for words in ("$: 'height_px' is a required", "$.cx_px: 'wide'", "$.fx_px: -1", "'extra'"):
        assert words in caught.value.what
    assert "docs/format.md" in caught.value.fix


def test_a_thousand_faults_stay_readable() -> None:
    document = {**INTRINSICS, **{f"key_{n}": n for n in range(1000)}, "model": "x" * 100_000}

    with pytest.raises(FormatError) as caught:
        check_document(document, kind="intrinsics", where="intrinsics.json")

    assert len(caught.value.what) < 40_000


def test_a_faulty_document_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="'extra' was unexpected"):
        write_document(tmp_path / "a.json", {**INTRINSICS, "extra": 1}, kind="intrinsics")

    assert list(tmp_path.iterdir()) == []


def test_vectors_stand_on_one_line_and_strings_are_left_alone() -> None:
    document = {"T": [[1.0, -2.5e-9], [3, 4]], "words": ["[\n  1,\n  2\n]", "a"], "none": []}

    text = document_text(document)

    assert "    [1.0, -2.5e-09],\n    [3, 4]\n" in text
    assert document_from_text(text, where="") == document
    assert text.endswith("}\n")
