"""The archive: the same folder, the same bytes; and out again what went in."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

from civil_rgbd.contribution.archive import SUMS, write_archive
from civil_rgbd.contribution.unpack import unpack_bridge
from civil_rgbd.errors import FormatError, OutputError

from .test_scaffold import contents


def test_the_same_folder_gives_the_same_bytes(bridge: Path, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere" / "B1"
    shutil.copytree(bridge, copy)
    for number, path in enumerate(sorted(copy.rglob("*"))):
        os.utime(path, (number, number))
        path.chmod(0o700)
    (copy / ".DS_Store").touch()

    one = write_archive(bridge, "B1", tmp_path / "one.tar")
    two = write_archive(copy, "B1", tmp_path / "two.tar")

    assert one.sha256 == two.sha256
    assert (tmp_path / "one.tar").read_bytes() == (tmp_path / "two.tar").read_bytes()
    assert one.size_bytes == (tmp_path / "one.tar").stat().st_size
    assert one.sha256 == hashlib.sha256((tmp_path / "one.tar").read_bytes()).hexdigest()


def test_the_standard_library_reads_it_and_finds_nothing_of_this_machine(
    bridge: Path, tmp_path: Path
) -> None:
    write_archive(bridge, "B1", tmp_path / "one.tar")

    with tarfile.open(tmp_path / "one.tar", "r:") as tar:
        members = tar.getmembers()
        sums = tar.extractfile(SUMS)
        assert sums is not None
        listed = dict(reversed(line.split("  ")) for line in sums.read().decode().splitlines())
    names = [member.name for member in members]
    assert names[:-1] == sorted(names[:-1])
    assert {(m.uid, m.gid, m.uname, m.gname, m.mtime, m.mode) for m in members} == {
        (0, 0, "", "", 315_532_800, 0o644)
    }
    assert listed == {
        f"B1/{name}": hashlib.sha256(data).hexdigest() for name, data in contents(bridge).items()
    }
    assert names == [*sorted(listed), SUMS]


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs the program sha256sum")
def test_a_person_can_check_the_sums_by_hand(bridge: Path, tmp_path: Path) -> None:
    write_archive(bridge, "B1", tmp_path / "one.tar")
    with tarfile.open(tmp_path / "one.tar", "r:") as tar:
        tar.extractall(tmp_path / "out", filter="data")

    done = subprocess.run(
        ["sha256sum", "-c", SUMS],  # noqa: S607 - whichever the machine has
        cwd=tmp_path / "out",
        check=False,
        capture_output=True,
    )

    assert done.returncode == 0


def test_what_goes_in_comes_out(bridge: Path, tmp_path: Path) -> None:
    archive = write_archive(bridge, "B1", tmp_path / "one.tar")

    count = unpack_bridge(tmp_path / "one.tar", "B1", tmp_path / "out")

    assert contents(tmp_path / "out") == contents(bridge)
    assert count == archive.files == len(contents(bridge))


def test_a_file_that_changed_since_it_was_built_stops_the_packing(
    bridge: Path, tmp_path: Path
) -> None:
    (bridge / "rgb/000007.jpg").write_bytes(b"another picture")

    with pytest.raises(FormatError, match=r"frames\.parquet says"):
        write_archive(bridge, "B1", tmp_path / "one.tar")

    assert list(tmp_path.glob("*one*")) == []


def test_a_file_that_is_gone_stops_the_packing(bridge: Path, tmp_path: Path) -> None:
    (bridge / "depth/000007.exr").unlink()

    with pytest.raises(OutputError, match="cannot be packed"):
        write_archive(bridge, "B1", tmp_path / "one.tar")

    assert list(tmp_path.glob("*one*")) == []
