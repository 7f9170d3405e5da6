"""A survey is checked to the last path before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.builder.survey import read_survey
from civil_rgbd.errors import UsageError
from civil_rgbd.resources import load_schema


def written(folder: Path, text: str) -> Path:
    for name in ("a.mcap", "b.mcap", "rig.toml", "poses.txt"):
        (folder / name).touch()
    path = folder / "survey.toml"
    path.write_text(text)
    return path


WHOLE = """
[defaults]
licence = "CC-BY-4.0"
rig = "rig.toml"

[[bridge]]
id = "park-street"
source = "a.mcap"
sha256 = "%s"
trajectory = "poses.txt"
trajectory_offset = 0.1
pose_of = "imu"

[[bridge]]
id = "mill"
source = ["a.mcap", "b.mcap"]
licence = "CC0-1.0"
rectified = true
""" % ("0" * 64)


def test_paths_are_relative_to_the_file_and_defaults_hold_where_nothing_else_is_said(
    tmp_path: Path,
) -> None:
    park, mill = read_survey(written(tmp_path, WHOLE))

    assert park.sources == (str(tmp_path / "a.mcap"),)
    assert park.sha256 == ("0" * 64,)
    assert park.licence == "CC-BY-4.0"
    assert park.rig == mill.rig == tmp_path / "rig.toml"
    assert park.reading["trajectory"] == tmp_path / "poses.txt"
    assert park.reading["trajectory_offset"] == "0.1"
    assert park.reading["pose_of"] == "imu"
    assert park.reading["rectified"] is False
    assert mill.sources == (str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap"))
    assert mill.licence == "CC0-1.0"
    assert mill.reading["rectified"] is True
    assert mill.reading["trajectory"] is None


def test_addresses_stay_as_they_are(tmp_path: Path) -> None:
    text = '[[bridge]]\nid = "far"\nsource = "s3://raw-scans/park.mcap"\n'

    (far,) = read_survey(written(tmp_path, text))

    assert far.sources == ("s3://raw-scans/park.mcap",)


def test_a_survey_knows_every_option_of_the_command_line() -> None:
    from civil_rgbd.cli.build import command

    elsewhere = {"sources", "recipe_name", "settings", "bridge_id", "dataset", "workers"}
    elsewhere |= {
        "executor",
        "scheduler",
        "chunk",
        "overwrite",
        "as_json",
        "help",
        "no_source_hash",
    }
    options = {parameter.name for parameter in command.params} - elsewhere
    properties = load_schema("survey")["properties"]
    keys = set(properties["bridge"]["items"]["properties"]) - {"id", "source", "sha256"}

    assert keys == {"rig" if name == "rig_path" else name for name in options}
    assert set(properties["defaults"]["properties"]) == keys


@pytest.mark.parametrize(
    ("text", "words", "fix"),
    [
        ('[[bridges]]\nid = "a"', "the survey has no key 'bridges'", "did you mean 'bridge'?"),
        (
            '[[bridge]]\nid = "a"\nsource = "a.mcap"\ntrajektory = "x"',
            "bridge 'a' has no key 'trajektory'",
            "did you mean 'trajectory'?",
        ),
        ('[defaults]\nid = "a"', r"\[defaults\] has no key 'id'", "Known: "),
        ("", "'bridge' is a required property", "docs/format.md"),
        ("bridge = []", "should be non-empty", "docs/format.md"),
        ('[[bridge]]\nid = "a b"\nsource = "a.mcap"', "does not match", "docs/format.md"),
        ('[[bridge]]\nid = "a"\nsource = 3', "is not of type", "docs/format.md"),
        (
            '[[bridge]]\nid = "a"\nsource = "a.mcap"\nsha256 = "abc"',
            "does not match",
            "docs/format.md",
        ),
        (
            '[[bridge]]\nid = "B3"\nsource = "a.mcap"\n[[bridge]]\nid = "b3"\nsource = "b.mcap"',
            "same id, ignoring case: 'B3', 'b3'",
            "an id of its own",
        ),
        ("[[bridge]\n", "no TOML", "mend the line"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path: Path, text: str, words: str, fix: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        read_survey(written(tmp_path, text))

    assert fix in caught.value.fix
    assert caught.value.where == str(tmp_path / "survey.toml")


def test_all_that_is_missing_is_listed(tmp_path: Path) -> None:
    text = '[[bridge]]\nid = "a"\nsource = "gone.mcap"\nrig = "r.toml"\nimages = "i"\n'

    with pytest.raises(UsageError, match=r"not there \(3\)") as caught:
        read_survey(written(tmp_path, text))

    for name in ("source", "rig", "images"):
        assert f"a: {name} " in caught.value.what
    assert str(tmp_path) in caught.value.fix


def test_a_survey_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read") as caught:
        read_survey(tmp_path / "survey.toml")

    assert "check the path" in caught.value.fix


def test_hashes_of_other_files_than_there_are_are_refused(tmp_path: Path) -> None:
    hashes = ", ".join(f'"{digit * 64}"' for digit in "12")
    (tmp_path / "a.mcap").touch()

    for source in ("a.mcap", "s3://raw/a.mcap"):
        text = f'[[bridge]]\nid = "a"\nsource = "{source}"\nsha256 = [{hashes}]\n'
        with pytest.raises(UsageError, match="sources: 1, but sha256: 2") as caught:
            read_survey(written(tmp_path, text))
        assert "one sha256 for each source" in caught.value.fix

    (tmp_path / "bag").mkdir()  # a folder may hold many files
    text = f'[[bridge]]\nid = "a"\nsource = "bag"\nsha256 = [{hashes}]\n'
    assert len(read_survey(written(tmp_path, text))[0].sha256) == 2
