"""The whole path, as a user walks it: simulate, build, kill, go on, validate, load."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from civil_rgbd import BridgeDataset
from civil_rgbd.cli import main
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.truth import true_depth

SMALL = ["--image-scale", "0.2", "--point-rate-hz", "30000", "--seconds", "4"]
SETTINGS = ["--set", "accumulate.points=30000", "--set", "image.scale=1.0"]


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("raw") / "underpass.mcap"
    assert main(["simulate", *SMALL, str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def dataset(raw: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dataset")
    assert main(["build", *SETTINGS, "--licence", "CC0-1.0", "--out", str(out), str(raw)]) == 0
    return out


def test_the_bridge_takes_its_id_from_the_file(dataset: Path) -> None:
    assert (dataset / "bridges/underpass/manifest.json").is_file()


def test_the_dataset_validates_without_findings(
    dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["validate", "--json", str(dataset)])

    assert status == 0
    assert json.loads(capsys.readouterr().out)["findings"] == []


def test_the_manifest_says_that_it_is_simulated_and_names_no_path(dataset: Path, raw: Path) -> None:
    text = (dataset / "bridges/underpass/manifest.json").read_text()

    assert json.loads(text)["origin"] == "simulated"
    assert str(raw.parent) not in text
    assert json.loads(text)["sources"][0]["name"] == "underpass.mcap"


def test_depth_is_the_truth_where_surfaces_are_seen_from_where_they_were_scanned(
    dataset: Path,
) -> None:
    """Points lie on surfaces without noise: a valid pixel errs by parallax and pixel size only."""
    spec = ScanSpec(image_scale=0.2, point_rate_hz=30_000, seconds=4.0)
    bridge = read_bridge(dataset / "bridges/underpass")
    errors = []
    for row in bridge.rows[::10]:
        depth = bridge.read_depth(row)
        truth = true_depth(spec, row.source_index, bridge.camera)
        both = (depth > 0) & (truth > 0)
        errors.append((np.abs(depth - truth) / np.where(both, truth, 1))[both])
    relative = np.concatenate(errors)

    assert np.median(relative) < 0.003
    assert np.mean(relative < 0.05) > 0.95


def test_the_same_build_without_the_truth_beside_it_gives_the_same_bytes(
    raw: Path, dataset: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "underpass.mcap"
    shutil.copy(raw, copy)
    assert main(["simulate", *SMALL, "--truth", "--overwrite", str(copy)]) == 0
    shutil.rmtree(tmp_path / "underpass.truth")
    out = tmp_path / "out"
    assert main(["build", *SETTINGS, "--licence", "CC0-1.0", "--out", str(out), str(copy)]) == 0

    def contents(folder: Path) -> dict[str, bytes]:
        return {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }

    assert contents(out) == contents(dataset)


def test_a_sample_is_what_the_page_promises(dataset: Path) -> None:
    sample = BridgeDataset(dataset, bridges=["underpass"])[0]

    assert sample["image"].shape == (3, 144, 256)
    assert sample["image"].dtype == torch.uint8
    assert sample["depth"].shape == (1, 144, 256)
    assert sample["depth"].dtype == torch.float32
    assert torch.equal(sample["valid"], sample["depth"] > 0)
    assert sample["intrinsics"].dtype == torch.float32
    assert sample["T_map_camera"].dtype == torch.float64
    assert sample["bridge"] == "underpass"


def test_two_workers_load_the_same_samples(dataset: Path) -> None:
    samples = BridgeDataset(dataset)
    loaded = DataLoader(samples, batch_size=4, num_workers=2)

    depths = torch.cat([batch["depth"] for batch in loaded])

    assert torch.equal(depths, torch.stack([sample["depth"] for sample in samples]))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no file sizes")
def test_a_disk_that_is_full_is_said_and_nothing_is_visible(raw: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "civil_rgbd", "build", *SETTINGS, "--workers", "1"]
    command += ["--out", str(tmp_path / "out"), str(raw)]

    done = subprocess.run(
        ["/bin/sh", "-c", 'ulimit -f 20 && exec "$@"', "sh", *command],  # 10 kB: no frame fits
        capture_output=True,
        check=False,
        text=True,
    )

    assert done.returncode == 2
    assert "cannot write" in done.stderr
    assert "free some space" in done.stderr
    assert not list(tmp_path.rglob("manifest.json"))


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_a_folder_that_is_not_writable_is_said(
    raw: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tmp_path.chmod(0o500)

    status = main(["build", *SETTINGS, "--out", str(tmp_path / "out"), str(raw)])

    assert status == 2
    assert "make the folder writable" in capsys.readouterr().err


@pytest.mark.slow
def test_a_command_that_is_killed_and_run_again_ends_with_the_same_bytes(
    raw: Path, dataset: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "civil_rgbd", "build", *SETTINGS, "--workers", "2"]
    command += ["--licence", "CC0-1.0", "--out", str(tmp_path), str(raw)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not list(tmp_path.rglob("*.exr")):
            pass
        process.kill()
    assert main(command[3:]) == 0

    for file in (dataset / "bridges/underpass").rglob("*.*"):
        twin = tmp_path / "bridges/underpass" / file.relative_to(dataset / "bridges/underpass")
        assert twin.read_bytes() == file.read_bytes(), file
