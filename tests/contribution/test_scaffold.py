"""Answers go into the manifest, and nothing else changes."""

from __future__ import annotations

import difflib
from pathlib import Path

import pytest

from civil_rgbd.contribution.answers import answers_of, info_of, read_answers, write_answers
from civil_rgbd.contribution.scaffold import known_answers, open_submission, write_submission
from civil_rgbd.errors import FormatError, OutputError, UsageError
from civil_rgbd.format.atomic import folder_lock
from civil_rgbd.format.bridge_info import bridge_info_from_toml
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.validation import validate

from .conftest import ANSWERS


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_only_the_words_in_the_manifest_change(bare: Path) -> None:
    before = contents(bare)

    place = open_submission(bare, "B1")
    written = write_submission(place, dict(ANSWERS))

    after = contents(bare)
    manifest = "bridges/B1/manifest.json"
    assert written == (bare / "B1.toml", bare / manifest)
    assert after.keys() - before.keys() == {"B1.toml"}
    assert {name for name in before if before[name] != after[name]} == {manifest}
    old, new = (text[manifest].decode().splitlines() for text in (before, after))
    parts = {'  "bridge": {', '  "contribution": {', '  "contribution": null,'}
    top = ""
    for line in difflib.ndiff(old, new):
        text = line[2:]
        if text.startswith('  "'):
            top = text
        assert line[0] in " ?" or top in parts, line


def test_after_all_answers_nothing_is_left_to_complain_of(submission: Path) -> None:
    assert validate(submission, profile="contribution").findings == ()


def test_what_is_said_already_is_kept(submission: Path) -> None:
    place = open_submission(submission, "B1")
    known = known_answers(place)

    write_submission(place, known | {"owner": "County of Nowhere"})

    assert known_answers(place) == {**ANSWERS, "owner": "County of Nowhere"}


def test_the_toml_beside_it_survives_a_new_build(submission: Path) -> None:
    (submission / "bridges/B1/manifest.json").unlink()
    place = open_submission(submission, "B1")

    assert not place.is_built
    assert known_answers(place) == ANSWERS
    assert answers_of(bridge_info_from_toml(place.toml, "B1")) == ANSWERS


def test_a_bridge_that_is_still_to_be_built_gets_its_toml(tmp_path: Path) -> None:
    place = open_submission(tmp_path / "new", "ca-on-0042")

    assert write_submission(place, dict(ANSWERS)) == (tmp_path / "new/ca-on-0042.toml",)
    assert info_of(known_answers(place), "ca-on-0042").licence == "CC-BY-4.0"


def test_the_file_that_was_given_is_not_written_over(bare: Path) -> None:
    given = bare / "B1.toml"
    write_answers(given, {"owner": "me"})
    given.write_text("# mine\n" + given.read_text())

    write_submission(open_submission(bare, "B1"), dict(ANSWERS), given=given)

    assert given.read_text().startswith("# mine")


@pytest.mark.parametrize(
    "words",
    ['say "no"\\', "two\nlines\tand a tab", "Brücke, 橋, \u00a0", "\x7f\x01", "# = [x]", "'''"],
)
def test_any_words_come_back_from_the_toml(tmp_path: Path, words: str) -> None:
    answers: dict[str, object] = {"owner": words, "structure.note": words, "survey_dates": ["2024"]}

    write_answers(tmp_path / "a.toml", answers)

    assert answers_of(bridge_info_from_toml(tmp_path / "a.toml", "B1")) == answers


def test_numbers_and_places_come_back_from_the_toml(tmp_path: Path) -> None:
    place = {"latitude_deg": 43.5, "longitude_deg": -1e-07, "precision_m": 1e20}
    answers: dict[str, object] = {
        "location": place,
        "structure.year_built": 1968,
        "structure.length_m": 65.25,
    }

    write_answers(tmp_path / "a.toml", answers)

    assert answers_of(bridge_info_from_toml(tmp_path / "a.toml", "B1")) == answers


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ('licence = "MIT OR CC-BY-4.0"', "an expression of several licences"),
        ('licence = "CC-BY-NC-ND-4.0"', "did you mean"),
        ('country = "XX"', "'XX' is no code of ISO 3166-1"),
        ('survey_dates = ["2023-02-30"]', "is no day of the calendar"),
        ('[structure]\ntype = "gider"', "'gider' is not one of"),
        ("ownr = 1", "bridge.toml has no key 'ownr'"),
        ('[contribution]\nface = "blurred"', "has no key 'face'"),
    ],
)
def test_answers_that_do_not_do_are_refused(tmp_path: Path, toml: str, words: str) -> None:
    (tmp_path / "a.toml").write_text(toml)

    with pytest.raises(UsageError, match=words):
        read_answers(tmp_path / "a.toml", "B1")


def test_the_usual_spelling_of_a_licence_is_mended(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('licence = "cc-by-sa-4.0"')

    assert read_answers(tmp_path / "a.toml", "B1") == {"licence": "CC-BY-SA-4.0"}


def test_a_build_at_work_is_waited_for_in_vain(bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("civil_rgbd.contribution.scaffold._LOCK_WAIT_S", 0.1)
    before = (bare / "bridges/B1/manifest.json").read_bytes()

    with (
        folder_lock(bare / ".partial/B1"),
        pytest.raises(OutputError, match="is writing here"),
    ):
        write_submission(open_submission(bare, "B1"), dict(ANSWERS))

    assert (bare / "bridges/B1/manifest.json").read_bytes() == before


def test_a_manifest_of_another_version_is_left_alone(bare: Path) -> None:
    path = bare / "bridges/B1/manifest.json"
    path.write_text(path.read_text().replace('"format_version": "1.0"', '"format_version": "9.0"'))
    before = path.read_bytes()

    with pytest.raises(FormatError, match=r"9\.0"):
        write_submission(open_submission(bare, "B1"), dict(ANSWERS))

    assert path.read_bytes() == before


def test_the_id_inside_is_not_changed(submission: Path) -> None:
    (submission / "bridges/B1").rename(submission / "bridges/B2")
    place = open_submission(submission, "B2")

    write_submission(place, dict(ANSWERS))

    assert read_manifest(submission / "bridges/B2/manifest.json").info.bridge_id == "B1"


def test_a_bridge_folder_is_no_place_to_write_to(submission: Path) -> None:
    with pytest.raises(UsageError, match="this is a bridge folder"):
        open_submission(submission / "bridges/B1", "B1")


@pytest.mark.parametrize("bridge_id", ["../B1", "", "b1", "B 1"])
def test_an_id_that_is_none_is_refused(submission: Path, bridge_id: str) -> None:
    with pytest.raises(UsageError, match=r"no bridge id|differs only in case"):
        open_submission(submission, bridge_id)
