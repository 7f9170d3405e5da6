"""Bridges built from and into object storage: the same bytes as on a disk, whatever dies."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import torch
from torch.utils.data import DataLoader

from civil_rgbd import BridgeDataset
from civil_rgbd.builder.bridge_build import Order
from civil_rgbd.builder.finish import finish_bridges
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge, build_bridges
from civil_rgbd.builder.shares import Share
from civil_rgbd.cli import main
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.errors import BuildError, OutputError, StorageError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.storage.places import files_below
from civil_rgbd.storage.remote_path import RemotePath
from civil_rgbd.validation import validate

from .conftest import Server, pulled

INFO = BridgeInfo("B9", licence="CC0-1.0")
SPEC = ScanSpec(seconds=3.0, image_scale=0.1, point_rate_hz=12_000, image_rate_hz=15.0)
SETTINGS = ("accumulate.points=8000",)
KILLS = 5


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.mcap"
    write_recording(path, SPEC, overwrite=False)
    return path


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return load_recipe("250k", SETTINGS)


@pytest.fixture(scope="module")
def local(scan: Path, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What has to come out: built from a disk onto a disk."""
    folder = tmp_path_factory.mktemp("local")
    build_bridge(open_recording(scan), recipe, folder, INFO, BuildOptions())
    return folder


@pytest.fixture(scope="module")
def wanted(local: Path) -> dict[str, bytes]:
    return {
        path.relative_to(local).as_posix(): path.read_bytes()
        for path in local.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def source(scan: Path, bucket: RemotePath) -> RemotePath:
    path = bucket / "raw/scan.mcap"
    path.write_bytes(scan.read_bytes())
    return path


@pytest.mark.parametrize("workers", [1, 2])
def test_a_build_between_buckets_gives_the_bytes_of_a_local_one(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes], workers: int
) -> None:
    recording = open_recording(source.url)
    report = build_bridge(recording, recipe, bucket / "sets", INFO, BuildOptions(workers=workers))

    assert report.folder == bucket / "sets/bridges/B9"
    assert pulled(bucket / "sets") == wanted


@pytest.mark.slow
def test_a_cluster_builds_between_buckets_by_itself(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes], s3: Server
) -> None:
    recording, before = open_recording(source.url), len(s3.requests())
    options = BuildOptions(workers=2, executor="dask")

    build_bridge(recording, recipe, bucket / "sets", INFO, options)

    assert pulled(bucket / "sets") == wanted
    fetched = [path for method, path, _ in s3.since(before) if method == "GET"]
    assert not [path for path in fetched if ".partial" in path and path.endswith(".exr")]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_build_goes_on_to_the_same_bytes(
    source: RemotePath, bucket: RemotePath, wanted: dict[str, bytes], workers: int
) -> None:
    script, out = Path(__file__).parent / "remote_build.py", bucket / "sets"
    generator, kills, begun = random.Random(workers), 0, 0  # noqa: S311  # no secret
    while True:
        process = subprocess.Popen(
            [sys.executable, str(script), source.url, out.url, str(workers)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        if kills < KILLS:
            # The first before anything can be whole, later ones ever further on.
            time.sleep(generator.uniform(0.0, 0.4) * (1 + 2 * kills))
            process.send_signal(signal.SIGKILL)
        code = process.wait(timeout=120)
        process.stdout.close()
        kills += code == -signal.SIGKILL
        begun += 1
        whole = (out / "bridges/B9/manifest.json").is_file()
        assert whole or "dataset.json" not in files_below(out)
        if code == 0:
            break
    assert pulled(out) == wanted
    assert begun > 1


def test_a_kill_between_copies_leaves_no_bridge_and_loses_nothing(
    source: RemotePath,
    bucket: RemotePath,
    recipe: Recipe,
    wanted: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from civil_rgbd.storage import remote_path

    recording, out = open_recording(source.url), bucket / "sets"
    copy, done = remote_path.RemotePath.copy_to, []

    def copy_some(path: RemotePath, target: RemotePath) -> None:
        if len(done) > 3:
            raise KeyboardInterrupt
        done.append(target)
        copy(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(remote_path.RemotePath, "copy_to", copy_some)
        with pytest.raises(KeyboardInterrupt):
            build_bridge(recording, recipe, out, INFO, BuildOptions())
    assert files_below(out / "bridges/B9")
    assert not (out / "bridges/B9/manifest.json").exists()

    report = build_bridge(recording, recipe, out, INFO, BuildOptions())
    assert report.frames_found >= report.counts.frames_kept
    assert pulled(out) == wanted


def test_a_bridge_built_otherwise_is_replaced_only_on_demand(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes]
) -> None:
    recording, out = open_recording(source.url), bucket / "sets"
    every = load_recipe("250k", [*SETTINGS, "select.min_displacement_m=0.3"])
    build_bridge(recording, every, out, INFO, BuildOptions())

    with pytest.raises(BuildError, match="built otherwise"):
        build_bridge(recording, recipe, out, INFO, BuildOptions())
    build_bridge(recording, recipe, out, INFO, BuildOptions(overwrite=True))
    assert pulled(out) == wanted


def make_part(source: RemotePath, recipe: Recipe, out: RemotePath, number: int) -> None:
    order = Order(INFO, open=lambda: open_recording(source.url))
    assert not build_bridges([order], recipe, out, BuildOptions(share=Share(number, 2))).failed


def test_parts_made_by_many_jobs_are_joined_without_reading_them(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes], s3: Server
) -> None:
    out = bucket / "sets"
    for number in (2, 1):
        make_part(source, recipe, out, number)
    assert not (out / "bridges").exists()
    before = len(s3.requests())

    assert not finish_bridges(out.url).failed
    fetched = [path for method, path, _ in s3.since(before) if method == "GET"]
    assert not [path for path in fetched if path.endswith((".exr", ".jpg"))]
    assert pulled(out) == wanted


def test_objects_that_are_not_what_was_uploaded_are_made_again(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes]
) -> None:
    out = bucket / "sets"
    for number in (1, 2):
        make_part(source, recipe, out, number)
    unfinished = out / ".partial/B9/bridge"
    depths = [unfinished / name for name in files_below(unfinished) if name.startswith("depth")]
    tampered = bytearray(depths[0].read_bytes())
    tampered[-1] ^= 1  # as long as it was
    damages = {depths[0]: (1, bytes(tampered)), depths[-1]: (2, b""), depths[-2]: (2, None)}

    for path, (number, data) in damages.items():
        path.unlink()
        if data is not None:
            path.write_bytes(data)
        (outcome,) = finish_bridges(out.url).outcomes
        assert f"parts {number}/2 are missing or damaged" in str(outcome.error)
        assert not (out / "bridges").exists()
        make_part(source, recipe, out, number)

    assert not finish_bridges(out.url).failed
    assert pulled(out) == wanted


def test_objects_that_were_copied_otherwise_are_read_and_hashed(
    source: RemotePath, bucket: RemotePath, recipe: Recipe, wanted: dict[str, bytes], s3: Server
) -> None:
    out = bucket / "sets"
    for number in (1, 2):
        make_part(source, recipe, out, number)
    name = next(name for name in files_below(out) if name.endswith(".exr"))
    place = {"Bucket": bucket.name, "Key": f"sets/{name}"}
    upload = s3.client().create_multipart_upload(**place)  # its ETag is no hash of the object
    part = {"UploadId": upload["UploadId"], "PartNumber": 1}
    tag = s3.client().upload_part(**place, **part, Body=(out / name).read_bytes())["ETag"]
    parts = {"Parts": [{"ETag": tag, "PartNumber": 1}]}
    s3.client().complete_multipart_upload(**place, UploadId=part["UploadId"], MultipartUpload=parts)
    before = len(s3.requests())

    assert not finish_bridges(out.url).failed
    fetched = [path for method, path, _ in s3.since(before) if method == "GET"]
    assert [path for path in fetched if path.endswith((".exr", ".jpg"))] == [
        f"/{bucket.name}/sets/{name}"
    ]
    assert pulled(out) == wanted


def test_two_builds_do_not_write_one_bridge(
    source: RemotePath, bucket: RemotePath, recipe: Recipe
) -> None:
    from civil_rgbd.storage.lease import leased

    recording, out = open_recording(source.url), bucket / "sets"
    with leased(out / ".partial/B9"), pytest.raises(OutputError, match="is writing here"):
        build_bridge(recording, recipe, out, INFO, BuildOptions())


def test_a_bucket_that_is_not_there_stops_a_build_before_it_begins(
    source: RemotePath, recipe: Recipe
) -> None:
    recording = open_recording(source.url)
    with pytest.raises(StorageError, match="no such bucket"):
        build_bridge(recording, recipe, RemotePath("s3://no-such/sets"), INFO, BuildOptions())


def test_a_full_temporary_folder_is_named_and_leaves_nothing(
    bucket: RemotePath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    with (
        pytest.raises(OutputError, match=r"way to s3://.*/x\.json: No space left") as caught,
        whole_file(bucket / "x.json"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert caught.value.where == str(tmp_path)
    assert "TMPDIR" in caught.value.fix
    assert files_below(bucket) == {}
    assert not list(tmp_path.iterdir())


@pytest.fixture
def remote_set(local: Path, bucket: RemotePath) -> RemotePath:
    """The local dataset, uploaded."""
    for path in local.rglob("*"):
        if path.is_file():
            (bucket / "sets" / path.relative_to(local).as_posix()).write_bytes(path.read_bytes())
    return bucket / "sets"


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_a_loader_reads_the_samples_of_a_disk_in_workers_of_any_kind(
    remote_set: RemotePath, local: Path, start: str
) -> None:
    ours, theirs = BridgeDataset(remote_set.url), BridgeDataset(local)
    first = ours[0]  # so that a fork inherits a client that was used

    loaded = list(DataLoader(ours, batch_size=4, num_workers=1, multiprocessing_context=start))

    assert torch.equal(first["depth"], theirs[0]["depth"])
    for key in ("image", "depth", "T_map_camera"):
        together = torch.cat([batch[key] for batch in loaded])
        assert torch.equal(together, torch.stack([sample[key] for sample in theirs]))


def test_reading_commands_take_urls(
    remote_set: RemotePath, local: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", "--json", remote_set.url]) == main(["info", "--json", str(local)]) == 0
    ours, theirs = capsys.readouterr().out.split("}\n{")
    theirs = "{" + theirs.replace(str(local), remote_set.url)
    assert json.loads(ours + "}") == json.loads(theirs)

    assert validate(remote_set.url).findings == validate(local).findings
    assert main(["export", remote_set.url, "--to", "kitti", "--out", str(tmp_path / "a")]) == 0
    assert main(["export", str(local), "--to", "kitti", "--out", str(tmp_path / "b")]) == 0
    assert {p.name: p.read_bytes() for p in (tmp_path / "a").rglob("*.png")} == {
        p.name: p.read_bytes() for p in (tmp_path / "b").rglob("*.png")
    }
    assert main(["pack", remote_set.url]) == 2
    assert "aws s3 sync" in capsys.readouterr().err


def test_damage_in_a_bucket_is_found(remote_set: RemotePath) -> None:
    rows = read_bridge(remote_set / "bridges/B9").rows
    (remote_set / "bridges/B9" / rows[0].depth_path).write_bytes(b"no depth")
    (remote_set / "bridges/B9" / rows[1].rgb_path).unlink()
    (remote_set / "bridges/B9/notes.txt").write_bytes(b"?")

    codes = {finding.code for finding in validate(remote_set.url).findings}

    assert codes == {"file-hash", "depth-unreadable", "file-missing", "file-unknown"}


def test_the_whole_way_by_the_command_line(
    source: RemotePath, bucket: RemotePath, capsys: pytest.CaptureFixture[str]
) -> None:
    out = (bucket / "sets").url
    more = ["--set", SETTINGS[0], "--licence", "CC0-1.0", "--workers", "1", "--no-source-hash"]
    assert main(["build", source.url, "--out", out, *more]) == 0
    capsys.readouterr()
    assert main(["verify", out]) == 0
    assert "scan: source not proved" in capsys.readouterr().out
    assert main(["verify", out, "--rebuild", "2", "--source", source.url]) == 0

    manifest = json.loads((bucket / "sets/bridges/scan/manifest.json").read_text())
    assert manifest["sources"][0]["sha256"] is None
    assert manifest["sources"][0]["etag"] == (source.stat().etag or "").strip('"')
    assert "source not proved" in capsys.readouterr().out
    assert main(["build", source.url, "--out", "s3://no-such-bucket/sets", *more]) == 2
    assert "no such bucket" in capsys.readouterr().err


def test_commands_that_need_a_disk_refuse_urls(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for command in (
        ["simulate", "s3://sets/scan.mcap"],
        ["convert", str(tmp_path), "--from", "tum", "--out", "s3://sets/a"],
        ["export", str(tmp_path), "--to", "tum", "--out", "s3://sets/a"],
        ["download", "B1", "--out", "s3://sets/a"],
        ["new-bridge", "B1", "--out", "s3://sets/a"],
    ):
        assert main(command) == 2
        assert "lies on object storage" in capsys.readouterr().err


@pytest.mark.usefixtures("s3")
def test_a_folder_that_is_not_there_is_named(bucket: RemotePath, s3: Server) -> None:
    del s3
    assert main(["info", (bucket / "nothing").url]) == 2
    assert main(["info", "s3://no-such-bucket/sets"]) == 2
