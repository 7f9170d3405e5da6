"""A built package knows the commit that it was built from, and bridges name it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STAMP = "civil_rgbd/source_commit.txt"
PROJECT = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"
[project]
name = "civil-rgbd"
version = "0.1.0"
[tool.setuptools]
packages = ["civil_rgbd"]
"""


def git(folder: Path, *arguments: str) -> str:
    who = ["-c", "user.name=Tester", "-c", "user.email=tester@example.org"]
    command = ["git", "-C", str(folder), *who, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def commit(folder: Path) -> str:
    git(folder, "init", "--quiet")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "All of it")
    return git(folder, "rev-parse", "HEAD")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A package of one file that is built as ours is."""
    pytest.importorskip("setuptools", minversion="77", reason="building needs setuptools >= 77")
    if shutil.which("git") is None:
        pytest.skip("needs git")
    folder = tmp_path / "project"
    (folder / "civil_rgbd").mkdir(parents=True)
    (folder / "civil_rgbd/__init__.py").write_text('"""Nothing."""\n')
    (folder / "pyproject.toml").write_text(PROJECT)
    (folder / ".gitignore").write_text("build/\n*.egg-info/\n")
    shutil.copy(ROOT / "setup.py", folder)
    return folder


def built(project: Path, kind: str) -> Path:
    """Build a wheel, an sdist or an editable wheel; return the file."""
    out = project.parent / f"out-{kind}"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    code = f"from setuptools import build_meta as b; b.build_{kind}({str(out)!r})"
    made = subprocess.run(
        [sys.executable, "-c", code], cwd=project, capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    (path,) = out.iterdir()
    return path


def stamp_of(wheel: Path) -> str | None:
    with zipfile.ZipFile(wheel) as archive:
        return archive.read(STAMP).decode() if STAMP in archive.namelist() else None


def test_what_is_built_from_a_checkout_names_its_commit(project: Path) -> None:
    name = commit(project)
    (project / "notes.txt").write_text("ships with nothing\n")

    assert stamp_of(built(project, "wheel")) == f"{name}\n"
    assert stamp_of(built(project, "editable")) is None
    assert git(project, "status", "--porcelain") == "?? notes.txt"


@pytest.mark.parametrize("file", ["__init__.py", "new.py"])
def test_files_that_differ_from_the_commit_are_said(project: Path, file: str) -> None:
    name = commit(project)
    (project / "civil_rgbd" / file).write_text('"""Something."""\n')

    assert stamp_of(built(project, "wheel")) == f"{name}-dirty\n"


def test_an_sdist_hands_its_commit_on_wherever_it_is_unpacked(project: Path) -> None:
    name = commit(project)
    elsewhere = project.parent / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "other.txt").write_text("of another repository\n")
    commit(elsewhere)

    with tarfile.open(built(project, "sdist")) as archive:
        archive.extractall(elsewhere, filter="data")

    assert stamp_of(built(elsewhere / "civil_rgbd-0.1.0", "wheel")) == f"{name}\n"


def test_without_a_checkout_nothing_is_claimed(project: Path) -> None:
    (project.parent / "other.txt").write_text("a repository around it\n")
    commit(project.parent)

    assert stamp_of(built(project, "wheel")) is None


def test_a_manifest_has_the_commit_of_the_build_else_the_one_that_pip_noted(
    tmp_path: Path,
) -> None:
    shutil.copytree(ROOT / "civil_rgbd", tmp_path / "civil_rgbd")
    (tmp_path / "civil_rgbd-0.1.0.dist-info").mkdir()
    (tmp_path / "civil_rgbd-0.1.0.dist-info/METADATA").write_text("Name: civil-rgbd\n")
    noted = {"url": "https://host/x.git", "vcs_info": {"vcs": "git", "commit_id": "c" * 40}}
    (tmp_path / "civil_rgbd-0.1.0.dist-info/direct_url.json").write_text(json.dumps(noted))

    assert commit_seen_in(tmp_path) == "c" * 40
    (tmp_path / STAMP).write_text(f"{'a' * 40}-dirty\n")
    assert commit_seen_in(tmp_path) == f"{'a' * 40}-dirty"


def commit_seen_in(folder: Path) -> str:
    code = "from civil_rgbd.builder.provenance import software; print(software().commit)"
    place = f"import sys; sys.path.insert(0, {str(folder)!r})"
    done = subprocess.run(
        [sys.executable, "-c", f"{place}; {code}"], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
