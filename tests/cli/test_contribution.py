"""``new-bridge``, ``validate --profile contribution``, ``pack`` and ``download`` as typed."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import pytest

from civil_rgbd.cli import main
from civil_rgbd.contribution.questions import QUESTIONS
from civil_rgbd.format.manifest import read_manifest

from ..contribution.conftest import ANSWERS, bare, bridge, submission  # noqa: F401 - fixtures
from ..contribution.server import Shelf, serving

Said = pytest.CaptureFixture[str]


def typed(monkeypatch: pytest.MonkeyPatch, lines: list[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


def in_words(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def test_answers_that_are_typed_make_a_contribution(
    bare: Path,  # noqa: F811 - the fixture
    monkeypatch: pytest.MonkeyPatch,
    capsys: Said,
) -> None:
    typed(monkeypatch, [in_words(ANSWERS.get(question.key, "")) for question in QUESTIONS])

    assert main(["new-bridge", "B1", "--out", str(bare)]) == 0
    said = capsys.readouterr()
    assert "Kind of structure" in said.err
    assert "one of: slab, girder, box girder" in said.err
    assert f"next: civil-rgbd validate {bare} --profile contribution" in said.out
    assert main(["validate", str(bare), "--profile", "contribution"]) == 0


def test_an_answer_that_does_not_do_is_asked_for_again(
    bare: Path,  # noqa: F811 - the fixture
    monkeypatch: pytest.MonkeyPatch,
    capsys: Said,
) -> None:
    lines = [in_words(ANSWERS.get(question.key, "")) for question in QUESTIONS]
    keys = [question.key for question in QUESTIONS]
    lines.insert(keys.index("licence"), "MIT OR CC0-1.0")
    lines.insert(keys.index("country"), "Canada")
    typed(monkeypatch, lines)

    assert main(["new-bridge", "B1", "--out", str(bare)]) == 0
    said = capsys.readouterr().err
    assert "'Canada' is no code of ISO 3166-1" in said
    assert "expression of several licences" in said
    info = read_manifest(bare / "bridges/B1/manifest.json").info
    assert (info.country, info.licence) == ("CA", "CC-BY-4.0")


def test_empty_answers_keep_and_a_dash_deletes(
    submission: Path,  # noqa: F811 - the fixture
    monkeypatch: pytest.MonkeyPatch,
    capsys: Said,
) -> None:
    typed(monkeypatch, ["-", *[""] * (len(QUESTIONS) - 1)])

    assert main(["new-bridge", "B1", "--out", str(submission)]) == 0
    assert "The bridge's name (may be left out) [Golden Bridge]" in capsys.readouterr().err
    info = read_manifest(submission / "bridges/B1/manifest.json").info
    assert info.name is None
    assert info.owner == "Town of Nowhere"


def test_answers_that_end_early_write_nothing(
    bare: Path,  # noqa: F811 - the fixture
    monkeypatch: pytest.MonkeyPatch,
    capsys: Said,
) -> None:
    before = (bare / "bridges/B1/manifest.json").read_bytes()
    typed(monkeypatch, ["Park Street", "town"])

    assert main(["new-bridge", "B1", "--out", str(bare)]) == 2
    assert "the answers end before the question" in capsys.readouterr().err
    assert (bare / "bridges/B1/manifest.json").read_bytes() == before
    assert not (bare / "B1.toml").exists()


def test_a_bridge_that_is_not_built_is_told_how_to_build_it(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "answers.toml").write_text('licence = "CC0-1.0"\n')
    out = tmp_path / "submission"

    status = main(["new-bridge", "B7", "--out", str(out), "--from", str(tmp_path / "answers.toml")])

    said = capsys.readouterr().out
    assert status == 0
    assert "still to be said for a contribution: contribution.place_precision, place" in said
    assert f"--bridge B7 --out {out} --bridge-info {out / 'B7.toml'}" in said


def test_gaps_give_1_and_say_what_to_do(
    bare: Path,  # noqa: F811 - the fixture
    capsys: Said,
) -> None:
    assert main(["validate", str(bare), "--profile", "contribution"]) == 1
    said = capsys.readouterr().out
    assert "contribution.place_precision is not stated" in said
    assert "contribution.plates is not stated" in said
    assert "`civil-rgbd new-bridge ID --out DATASET` asks for it" in said
    assert "licence-unstated" not in said
    assert "... and" not in said


def test_a_bridge_with_gaps_is_not_packed(
    bare: Path,  # noqa: F811 - the fixture
    tmp_path: Path,
    capsys: Said,
) -> None:
    out = tmp_path / "out" / "a.tar"

    assert main(["pack", str(bare), "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "error: contribution-consent" in said
    assert said.endswith("not packed: the contribution profile is not met\n")
    assert not out.parent.exists()


def test_a_folder_that_was_changed_is_not_packed_and_not_blamed_on_the_profile(
    submission: Path,  # noqa: F811 - the fixture
    tmp_path: Path,
    capsys: Said,
) -> None:
    copy = tmp_path / "copy" / submission.name
    shutil.copytree(submission, copy)
    image = next(copy.rglob("rgb/*.*"))
    image.write_bytes(image.read_bytes() + b"!")

    assert main(["pack", str(copy), "--out", str(tmp_path / "a.tar")]) == 1
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("not packed: the folder is damaged or was changed by hand (")
    assert "profile" not in said


def test_packed_listed_and_downloaded_it_is_the_same_bridge(
    submission: Path,  # noqa: F811 - the fixture
    tmp_path: Path,
    capsys: Said,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["pack", str(submission)]) == 0
    said = capsys.readouterr().out
    assert "report    B1-1.0.html" in said
    entry = json.loads(said[said.index("{") :])
    shelf = Shelf({"/B1.tar": (tmp_path / "B1-1.0.tar").read_bytes()})
    with serving(shelf) as address:
        registry = {"format_version": "1.0", "bridges": [entry | {"where": f"{address}/B1.tar"}]}
        (tmp_path / "mine.json").write_text(json.dumps(registry))

        status = main(["download", "B1", "--out", "data", "--registry", "mine.json"])

    assert status == 0
    assert f"verified  {entry['sha256']}" in capsys.readouterr().out
    assert main(["validate", "data", "--profile", "contribution"]) == 0
