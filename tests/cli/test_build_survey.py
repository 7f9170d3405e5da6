"""Surveys, parts and proofs on the command line: exit codes, and what is said."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from civil_rgbd.cli import main
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec

SPEC = ScanSpec(seconds=2.0, image_scale=0.1, point_rate_hz=12_000)
RECIPE = ("--recipe", "250k", "--set", "accumulate.points=4000")
SURVEY = """
[defaults]
licence = "CC0-1.0"

[[bridge]]
id = "north"
source = "raw/north.mcap"

[[bridge]]
id = "south"
source = "raw/south.mcap"
"""


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("survey")
    (folder / "raw").mkdir()
    for seed, name in enumerate(("north", "south")):
        write_recording(folder / f"raw/{name}.mcap", dataclasses.replace(SPEC, seed=seed))
    (folder / "survey.toml").write_text(SURVEY)
    return folder / "survey.toml"


@pytest.fixture(scope="module")
def built(survey: Path) -> Path:
    out = survey.parent / "built"
    assert main(["build", *RECIPE, "--workers", "1", "--out", str(out), str(survey)]) == 0
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_survey_gives_a_table_and_the_folders_that_single_builds_give(
    built: Path, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("north", "south"):
        source = survey.parent / f"raw/{name}.mcap"
        more = ["--workers", "1", "--licence", "CC0-1.0", "--out", str(tmp_path), str(source)]
        assert main(["build", *RECIPE, *more]) == 0
    capsys.readouterr()

    assert main(["build", *RECIPE, "--workers", "1", "--out", str(built), str(survey)]) == 0

    assert files(tmp_path) == files(built)
    header, north, south, _, total = capsys.readouterr().out.splitlines()
    assert header.split()[0] == "bridge"
    assert north.split()[0] == "north"
    assert south.split()[-1] == "found"
    assert total.startswith("2 of 2 bridges")


def test_one_bridge_of_a_survey_can_be_built_alone(
    survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--workers", "1", "--bridge", "south", "--json", "--out", str(tmp_path), str(survey)]

    assert main(["build", *RECIPE, *more]) == 0

    (only,) = json.loads(capsys.readouterr().out)["bridges"]
    assert only["bridge_id"] == "south"
    assert main(["build", *RECIPE, "--bridge", "suoth", str(survey)]) == 2
    assert "did you mean 'south'?" in capsys.readouterr().err


def test_a_failed_bridge_gives_exit_code_1_and_the_others(
    survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "torn.mcap").write_bytes((survey.parent / "raw/north.mcap").read_bytes()[:9000])
    text = SURVEY.replace("raw/north.mcap", str(tmp_path / "torn.mcap"))
    (tmp_path / "raw").symlink_to(survey.parent / "raw")
    (tmp_path / "survey.toml").write_text(text)

    out = str(tmp_path / "out")
    status = main(["build", *RECIPE, "--workers", "1", "--out", out, str(tmp_path / "survey.toml")])

    said = capsys.readouterr().out
    assert status == 1
    assert "north failed: the recording is damaged" in said
    assert "1 of 2 bridges" in said
    assert [path.name for path in (tmp_path / "out/bridges").iterdir()] == ["south"]


def test_another_hash_than_the_survey_says_fails_the_bridge(
    survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = survey.parent / "raw/north.mcap"
    text = f'[[bridge]]\nid = "north"\nsource = "{source}"\nsha256 = "{"0" * 64}"\n'
    (tmp_path / "survey.toml").write_text(text)

    status = main(["build", "--out", str(tmp_path / "out"), str(tmp_path / "survey.toml")])

    assert status == 1
    said = capsys.readouterr().out
    assert f"should have sha256 {'0' * 64}; north.mcap has" in said
    assert f"where: {tmp_path / 'survey.toml'}, bridge 'north'" in said


def test_a_hash_that_nobody_wants_taken_is_no_other_hash(survey: Path, tmp_path: Path) -> None:
    source = survey.parent / "raw/north.mcap"
    text = f'[[bridge]]\nid = "north"\nsource = "{source}"\nsha256 = "{"0" * 64}"\n'
    (tmp_path / "survey.toml").write_text(text)
    build = ["build", *RECIPE, "--workers", "1", "--no-source-hash", "--out", str(tmp_path / "out")]

    assert main([*build, str(tmp_path / "survey.toml")]) == 0

    manifest = json.loads((tmp_path / "out/bridges/north/manifest.json").read_text())
    assert manifest["sources"][0]["sha256"] is None


def test_every_option_that_a_survey_forbids_beside_it_is_a_key_of_it() -> None:
    from civil_rgbd.cli.build import command
    from civil_rgbd.resources import load_schema

    keys = load_schema("survey")["properties"]["bridge"]["items"]["properties"]
    own = {"recipe", "set", "bridge", "out", "workers", "executor", "scheduler", "chunk"}
    own |= {"overwrite", "no_source_hash", "json"}
    options = {
        parameter.opts[0].lstrip("-").replace("-", "_")
        for parameter in command.params
        if parameter.opts[0].startswith("-")
    }
    assert options - own <= set(keys)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rig", "rig.toml"], "--rig speaks of one recording, a survey of many"),
        (["--rig", "rig.toml"], "under [defaults]: rig = ..."),
        (["raw/a.mcap"], "a survey stands alone"),
        (["--licence", "MIT"], "--licence speaks of one recording"),
        (["--chunk", "1/2", "--executor", "dask"], "--chunk makes one part of a build here"),
        (["--scheduler", "tcp://a:1", "--executor", "serial"], "--scheduler is the address of"),
        (["--scheduler", ""], "is a variable not set?"),
        (["--executor", "serial", "--workers", "2"], "--executor serial makes one chunk at a time"),
        (["--chunk", "3/2"], "parts count from 1"),
    ],
)
def test_options_that_do_not_go_together_are_said(
    options: list[str], words: str, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", *options, "--out", str(tmp_path / "out"), str(survey)]) == 2

    said = capsys.readouterr().err
    assert words in said
    assert "fix:" in said
    assert not (tmp_path / "out").exists()


def test_parts_of_a_survey_are_joined(
    built: Path, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = ["build", *RECIPE, "--workers", "1", "--out", str(tmp_path), str(survey), "--chunk"]
    assert [main([*part, f"{number}/3"]) for number in (1, 3)] == [0, 0]
    assert "part 3/3: " in capsys.readouterr().out
    assert main(["finish", str(tmp_path)]) == 1
    assert "parts 2/3 are missing or damaged" in capsys.readouterr().out

    assert main([*part, "2/3"]) == 0
    assert main(["finish", str(tmp_path), "--bridge", "north"]) == 0
    assert main(["finish", str(tmp_path)]) == 0

    assert files(tmp_path) == files(built)
    # A job that is put into the queue again finds it done.
    assert main(["finish", str(tmp_path)]) == 0
    assert files(tmp_path) == files(built)


def test_nothing_is_joined_where_no_part_was_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["finish", str(tmp_path)]) == 2
    assert "no unfinished bridge" in capsys.readouterr().err


def test_a_source_that_changed_between_two_runs_is_refused(
    survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "scan.mcap"
    source.write_bytes((survey.parent / "raw/north.mcap").read_bytes())
    part = ["build", *RECIPE, "--out", str(tmp_path / "out"), str(source)]
    assert main([*part, "--chunk", "1/2"]) == 0
    source.write_bytes((survey.parent / "raw/south.mcap").read_bytes())

    assert main([*part, "--chunk", "2/2"]) == 2

    said = capsys.readouterr().err
    assert "begun otherwise (different: sources" in said
    assert "scan.mcap had sha256" in said


def test_verify_proves_a_dataset_from_its_survey_or_its_sources(
    built: Path, survey: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = [survey.parent / "raw/south.mcap", survey.parent / "raw/north.mcap"]

    assert main(["verify", str(built)]) == 0
    assert main(["verify", str(built), "--rebuild", "4", "--survey", str(survey)]) == 0
    given = [word for source in sources for word in ("--source", str(source))]
    capsys.readouterr()
    assert main(["verify", str(built), "--rebuild", "4", "--json", *given]) == 0

    rebuilt = json.loads(capsys.readouterr().out)["rebuilt"]
    assert sum(one["frames"] for one in rebuilt) == 4
    assert all(one["differences"] == [] and one["proved"] for one in rebuilt)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rebuild", "2"], "the raw recording of bridge 'north' is not given: north.mcap"),
        (["--source", "x.mcap"], "no frame is to be rendered again"),
        (["--rebuild", "2", "--source", "SURVEY"], "no bridge was built from this source"),
        (["--rebuild", "2", "--source", "gone.mcap"], "there is no such file or folder"),
    ],
)
def test_verify_says_what_it_needs(
    options: list[str], words: str, built: Path, survey: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [str(survey) if word == "SURVEY" else word for word in options]

    assert main(["verify", str(built), *options]) == 2

    said = capsys.readouterr().err
    assert words in said
    assert "fix:" in said


@pytest.mark.parametrize(
    "arguments",
    [
        ["build", "--out", "OUT", "s3://raw-scans/survey.toml"],
        ["build", "--executor", "dask", "--out", "OUT", "s3://raw-scans/survey.toml"],
        ["verify", "BUILT", "--rebuild", "2", "--survey", "s3://raw-scans/survey.toml"],
    ],
)
def test_a_survey_on_object_storage_is_to_be_fetched(
    arguments: list[str], built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"OUT": str(tmp_path / "out"), "BUILT": str(built)}

    assert main([places.get(word, word) for word in arguments]) == 2

    assert "aws s3 cp s3://raw-scans/survey.toml ." in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("within", ["", "/metadata.yaml"])
def test_verify_finds_whose_folder_a_source_is(
    within: str, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("south", "north")
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "part_0.mcap").write_bytes(
            (survey.parent / f"raw/{name}.mcap").read_bytes()
        )
        (tmp_path / name / "metadata.yaml").write_text(
            "storage_identifier: mcap\nrelative_file_paths:\n- part_0.mcap\n"
        )
    lines = [f'[[bridge]]\nid = "{name}"\nsource = "{name}"\n' for name in names]
    (tmp_path / "survey.toml").write_text("".join(lines))
    out = str(tmp_path / "out")
    more = ["--workers", "1", "--out", out, str(tmp_path / "survey.toml")]
    assert main(["build", *RECIPE, *more]) == 0
    given = [word for name in names for word in ("--source", f"{tmp_path}/{name}{within}")]
    capsys.readouterr()

    assert main(["verify", out, "--rebuild", "4", "--json", *given]) == 0

    rebuilt = json.loads(capsys.readouterr().out)["rebuilt"]
    assert {one["bridge_id"] for one in rebuilt} == set(names)
    assert all(one["differences"] == [] and one["proved"] for one in rebuilt)


def test_sources_without_a_hash_are_found_by_name_and_size_and_said_unproved(
    survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--workers", "1", "--no-source-hash", "--out", str(tmp_path)]
    assert main(["build", *RECIPE, *more, str(survey)]) == 0
    names = ("south", "north")
    given = [word for name in names for word in ("--source", f"{survey.parent}/raw/{name}.mcap")]
    capsys.readouterr()

    assert main(["verify", str(tmp_path)]) == 0
    alone = capsys.readouterr().out
    assert main(["verify", str(tmp_path), "--rebuild", "2", *given]) == 0
    rebuilt = capsys.readouterr().out
    assert main(["verify", str(tmp_path), "--json"]) == 0

    for name in names:
        assert f"{name}: source not proved" in alone
        assert rebuilt.count(f"{name}: source not proved") == 1
    assert json.loads(capsys.readouterr().out)["sources_not_proved"] == ["north", "south"]


def test_verify_finds_a_changed_picture(
    built: Path, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    shutil.copytree(built, tmp_path / "copy")
    picture = min((tmp_path / "copy").rglob("*.jpg"))
    data = bytearray(picture.read_bytes())
    data[-40] ^= 1
    picture.write_bytes(bytes(data))

    status = main(["verify", str(tmp_path / "copy"), "--rebuild", "2", "--survey", str(survey)])

    said = capsys.readouterr().out
    assert status == 1
    assert "file-hash" in said
    assert "nothing was rendered again" in said
