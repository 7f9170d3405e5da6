"""The whole check: every bridge of a location, every frame of a bridge."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from civil_rgbd.format.layout import (
    FRAMES,
    INTRINSICS,
    MANIFEST,
    POSES,
    bridge_folders,
    is_bridge,
    is_dataset,
)
from civil_rgbd.storage.places import Place, place_of
from civil_rgbd.validation.contribution import check_contribution
from civil_rgbd.validation.datasets import bridge_entries, check_dataset
from civil_rgbd.validation.documents import (
    BridgeDocuments,
    check_defects,
    check_intrinsics,
    check_manifest,
    read_documents,
)
from civil_rgbd.validation.files import check_files
from civil_rgbd.validation.frames import check_frame, frame_rules
from civil_rgbd.validation.index import check_index, check_poses
from civil_rgbd.validation.report import Finding, Report

PROFILES: Final = ("format", "contribution")
"""What can be asked for: that the folder is what the format says, and what a submission needs."""

Progress = Callable[[int, int], object]
"""Called with the frames just checked and the frames in all."""


@dataclass(frozen=True, slots=True)
class _Task:
    """One bridge to check."""

    name: str
    folder: Place
    read: BridgeDocuments


def validate(
    location: str | Place,
    *,
    profile: str = "format",
    progress: Progress = lambda _done, _total: None,
) -> Report:
    """Check a dataset or one bridge against the format.

    Args:
        location: a dataset folder or one bridge folder.
        profile: one of :data:`PROFILES`; ``contribution`` asks for all that a submission needs.
        progress: called after every frame.

    Returns:
        everything that was found; damage is a finding, never an error.

    Raises:
        FormatError: there is no such folder, or it is neither a dataset nor a bridge.
        ValueError: there is no such profile.
    """
    if profile not in PROFILES:
        raise ValueError(f"profile {profile!r} is none of {', '.join(PROFILES)}")
    location = place_of(location)
    findings: list[Finding] = []
    in_dataset = is_dataset(location) and not is_bridge(location)
    folders = _bridges_of(location, findings, in_dataset=in_dataset)
    tasks = [_Task(name, folder, read_documents(folder, name)) for name, folder in folders.items()]
    total = sum(len(task.read.rows or ()) for task in tasks)
    for task in tasks:
        findings += _check_documents(task, in_dataset=in_dataset)
        if profile == "contribution":
            # It says the same of the licence, as an error.
            findings = [found for found in findings if found.code != "licence-unstated"]
            findings += check_contribution(task.read, task.name)
        rules = frame_rules(task.read)
        for row in task.read.rows or ():
            findings += check_frame(task.folder, row, rules, task.name)
            progress(1, total)
    if in_dataset:
        findings += check_dataset(location, {task.name: _frame_ids(task) for task in tasks})
    return Report(str(location), tuple(folders), total, tuple(findings))


def _bridges_of(location: Place, findings: list[Finding], *, in_dataset: bool) -> dict[str, Place]:
    """Find the bridges to check; those without a manifest become findings."""
    if not in_dataset:
        if _is_unfinished(location):
            findings.append(_unfinished(location.resolve().name))
            return {}
        return bridge_folders(location)
    folders, found = bridge_entries(location)
    findings += found
    findings += [_unfinished(name) for name, folder in folders.items() if not is_bridge(folder)]
    return {name: folder for name, folder in folders.items() if is_bridge(folder)}


def _is_unfinished(location: Place) -> bool:
    documents = (INTRINSICS, POSES, FRAMES)
    return not is_bridge(location) and any((location / name).is_file() for name in documents)


def _unfinished(name: str) -> Finding:
    return Finding("manifest-missing", "the folder has no manifest", MANIFEST, name)


def _check_documents(task: _Task, *, in_dataset: bool) -> Iterator[Finding]:
    read, name = task.read, task.name
    yield from read.findings
    yield from check_manifest(read, name, in_dataset=in_dataset)
    yield from check_intrinsics(read, name)
    yield from check_index(read, name)
    yield from check_poses(read, name)
    yield from check_defects(read, name)
    yield from check_files(task.folder, read.rows, name)


def _frame_ids(task: _Task) -> frozenset[str] | None:
    rows = task.read.rows
    return None if rows is None else frozenset(row.frame_id for row in rows)
