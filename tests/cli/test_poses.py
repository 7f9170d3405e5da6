"""``civil-rgbd poses`` from outside, with an engine that answers as it is told."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from civil_rgbd.cli import main
from civil_rgbd.converters import open_motion
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.engines import ENGINES
from civil_rgbd.odometry.tum import tum_text
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import imu_poses
from civil_rgbd.trajectories.files import read_trajectory, read_trajectory_file

from ..odometry.fakes import fake_environment

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the stand-in engines are scripts")

ANSWER = "(out / 'x_tum.txt').write_text(truth)"
SETTLING_ANSWER = """
rows = [row.split() for row in truth.splitlines()]
poses = [row for row in rows if row and row[0] != '#']
for at, row in enumerate(poses[:12]):  # it believes to stand, then catches up with the walk
    row[1] = repr(float(row[1]) + 0.1 * (12 - at))
(out / 'x_tum.txt').write_text('\\n'.join(' '.join(row) for row in rows))
"""
SECONDS, RATE = 3, 24_000


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw.mcap"
    options = ["--seconds", str(SECONDS), "--image-scale", "0.05", "--image-rate-hz", "1"]
    assert main(["simulate", str(path), *options, "--point-rate-hz", str(RATE)]) == 0
    return path


def environment(folder: Path, raw: Path, code: str = ANSWER) -> Path:
    made = fake_environment(folder / "environment", ENGINES["genz-lio"], code)
    motion = open_motion(raw)
    ends = np.array([motion.read_scan(k).end_ns for k in range(len(motion.scan_stamps_ns))])
    path = Trajectory(ends, *imu_poses(ScanSpec(seconds=SECONDS, point_rate_hz=RATE), ends))
    (made / "truth.tum").write_text(tum_text(path))
    return made


def test_poses_are_written_with_their_quality_and_what_is_weak_is_said(
    tmp_path: Path, raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = environment(tmp_path, raw, SETTLING_ANSWER)
    out = tmp_path / "found" / "poses.tum"

    code = main(["poses", str(raw), "--out", str(out), "--environment", str(folder)])

    said = capsys.readouterr().out
    assert code == 1
    assert f"poses.tum: {10 * SECONDS} poses of the IMU over 2.9 s" in said
    assert "the IMU's specific force is in g" in said
    assert "poses cannot be trusted, whatever the engine says:" in said
    assert "up to 28 cm a second" in said
    assert "next: civil-rgbd build --trajectory poses.tum ..." in said
    assert read_trajectory_file(out).body == "imu"  # its own heading says so
    assert sorted(path.name for path in out.parent.iterdir()) == ["poses.quality.csv", "poses.tum"]
    found = read_trajectory(out)
    assert found.quality is not None
    assert (found.quality[:9] < 0.5).all()
    assert (found.quality[24:] > 0.5).all()


def split(raw: Path, folder: Path) -> list[str]:
    """Cut a recording in two files, as recorders do when one grows too large."""
    parts = [folder / f"raw_{at}.mcap" for at in range(2)]
    with raw.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    for part, chosen in zip(parts, (messages[: len(messages) // 2], messages), strict=True):
        with part.open("wb") as file:
            writer = Writer(file)
            writer.start()
            schemas: dict[str, int] = {}
            channels: dict[str, int] = {}
            for schema, channel, message in chosen[0 if part is parts[0] else len(messages) // 2 :]:
                assert schema is not None
                name, kind = channel.topic, schema.name
                if kind not in schemas:
                    schemas[kind] = writer.register_schema(kind, schema.encoding, schema.data)
                if name not in channels:
                    channels[name] = writer.register_channel(name, "cdr", schemas[kind])
                writer.add_message(
                    channels[name], message.log_time, message.data, message.publish_time
                )
            writer.finish()
    return [str(part) for part in parts]


def test_the_files_of_a_split_recording_are_one_walk(
    tmp_path: Path, raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = environment(tmp_path, raw)
    parts = split(raw, tmp_path)
    given = ["--environment", str(folder)]

    whole = main(["poses", str(raw), *given, "--out", str(tmp_path / "whole.tum")])
    assert main(["poses", *parts, *given, "--out", str(tmp_path / "split.tum")]) == whole
    capsys.readouterr()
    main(["inspect-recording", *parts])

    assert (tmp_path / "split.tum").read_bytes() == (tmp_path / "whole.tum").read_bytes()
    assert "raw_0.mcap and 1 more file: mcap" in capsys.readouterr().out


def test_a_failed_engine_leaves_nothing_and_what_was_there_stays(
    tmp_path: Path, raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = environment(tmp_path, raw, "sys.exit('out of memory')")
    out = tmp_path / "found" / "poses.tum"
    out.parent.mkdir()
    out.write_text("old")

    code = main(["poses", str(raw), "--out", str(out), "--environment", str(folder), "--overwrite"])

    assert code == 2
    assert "out of memory" in capsys.readouterr().err
    assert out.read_text() == "old"
    assert [path.name for path in out.parent.iterdir()] == ["poses.tum"]


def test_what_is_there_is_not_overwritten_unasked(
    tmp_path: Path, raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "poses.tum"
    out.write_text("old")

    code = main(["poses", str(raw), "--out", str(out)])

    assert code == 2
    assert "give --overwrite" in capsys.readouterr().err


def test_a_missing_engine_is_asked_for_before_the_recording_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(
        ["poses", "no.mcap", "--environment", str(tmp_path / "e"), "--out", str(tmp_path / "p.tum")]
    )

    assert code == 2
    said = capsys.readouterr().err
    assert "genz-lio is not installed" in said
    assert "--create-environment" in said


def test_what_the_engine_was_given_is_kept_on_request(tmp_path: Path, raw: Path) -> None:
    folder, keep = environment(tmp_path, raw), tmp_path / "kept"
    options = ["--out", str(tmp_path / "poses.tum"), "--environment", str(folder)]

    assert main(["poses", str(raw), *options, "--keep", str(keep)]) == 0

    kept = sorted(path.relative_to(keep).as_posix() for path in keep.rglob("*") if path.is_file())
    assert kept == ["engine.log", "in/scan.bag", "out/x_tum.txt", "settings.yaml"]


def test_a_name_that_is_no_tum_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["poses", "raw.mcap", "--out", str(tmp_path / "poses.mcap")]) == 2
    assert "write to 'poses.tum'" in capsys.readouterr().err


def test_who_is_told_to_end_takes_the_engine_along_and_leaves_nothing(
    tmp_path: Path, raw: Path
) -> None:
    note = tmp_path / "engine.pid"
    code = f"import os, time; Path({str(note)!r}).write_text(str(os.getpid())); time.sleep(60)"
    folder, out = environment(tmp_path, raw, code), tmp_path / "found" / "poses.tum"
    arguments = ["poses", str(raw), "--out", str(out), "--environment", str(folder)]
    command = subprocess.Popen([sys.executable, "-m", "civil_rgbd", *arguments])
    for _ in range(300):
        if note.exists() and note.read_text():
            break
        time.sleep(0.1)

    command.terminate()

    assert command.wait(timeout=20) == 128 + signal.SIGTERM
    with pytest.raises(ProcessLookupError):
        os.kill(int(note.read_text()), 0)
    assert list(out.parent.iterdir()) == []
