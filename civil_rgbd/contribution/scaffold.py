"""Answers, written where they belong: into a built bridge's manifest, and beside it as TOML."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.builder.bridge import remove_if_empty, require_free_id
from civil_rgbd.constants import BRIDGE_ID_PATTERN
from civil_rgbd.contribution.answers import (
    Answers,
    answers_of,
    info_of,
    read_answers,
    write_answers,
)
from civil_rgbd.errors import UsageError
from civil_rgbd.format.atomic import folder_lock, writing
from civil_rgbd.format.bridge_info import bridge_info_from_toml, info_to_document
from civil_rgbd.format.documents import read_document, write_document
from civil_rgbd.format.layout import BRIDGES, MANIFEST, PARTIAL, is_bridge
from civil_rgbd.format.manifest import manifest_from_document, read_manifest

_LOCK_WAIT_S = 5.0


@dataclass(frozen=True, slots=True)
class Submission:
    """Where the words about one bridge belong.

    Attributes:
        dataset: the dataset folder.
        bridge_id: the bridge, built or still to be built.
    """

    dataset: Path
    bridge_id: str

    def __post_init__(self) -> None:
        if not re.fullmatch(BRIDGE_ID_PATTERN, self.bridge_id):
            raise ValueError(f"bridge id {self.bridge_id!r} does not match {BRIDGE_ID_PATTERN}")

    @property
    def folder(self) -> Path:
        """The bridge folder."""
        return self.dataset / BRIDGES / self.bridge_id

    @property
    def toml(self) -> Path:
        """The answers, kept beside the bridges for the next build."""
        return self.dataset / f"{self.bridge_id}.toml"

    @property
    def is_built(self) -> bool:
        """Tell whether the bridge is there."""
        return is_bridge(self.folder)


def open_submission(dataset: Path, bridge_id: str) -> Submission:
    """Return where the words about a bridge belong.

    Raises:
        UsageError: the id is none, or the place is a bridge folder.
    """
    if is_bridge(dataset):
        raise UsageError(
            "this is a bridge folder; its words are written by way of its dataset",
            where=dataset,
            fix="give the folder that was the `--out` of the build",
        )
    require_free_id(dataset, bridge_id)
    return Submission(dataset, bridge_id)


def known_answers(submission: Submission) -> Answers:
    """Return what is said already: the manifest's words, over those of the TOML beside it.

    Raises:
        FormatError: the manifest is damaged.
        UsageError: the TOML is.
    """
    answers: Answers = {}
    if submission.toml.is_file():
        answers |= answers_of(bridge_info_from_toml(submission.toml, submission.bridge_id))
    if submission.is_built:
        answers |= answers_of(read_manifest(submission.folder / MANIFEST).info)
    return answers


def laid_over(answers: Answers, path: Path, bridge_id: str) -> Answers:
    """Return the answers with those of a ``bridge.toml`` laid over them.

    Raises:
        UsageError: the file does not do.
    """
    return answers | read_answers(path, bridge_id)


def write_submission(
    submission: Submission, answers: Answers, *, given: Path | None = None
) -> tuple[Path, ...]:
    """Write answers into the manifest of a built bridge, and into the TOML beside the bridges.

    No other file of the bridge is touched, and no other part of its manifest: hashes stay right.

    Args:
        submission: where.
        answers: all that is known of the bridge.
        given: the file that the answers came from; it is not written over.

    Returns:
        the files that were written.

    Raises:
        FormatError: the manifest is damaged or of another version.
        OutputError: a file cannot be written, or a build is at work on the bridge.
    """
    written = []
    with writing(submission.dataset):
        submission.dataset.mkdir(parents=True, exist_ok=True)
    if given is None or given.resolve() != submission.toml.resolve():
        write_answers(submission.toml, answers)
        written.append(submission.toml)
    if submission.is_built:
        partial = submission.dataset / PARTIAL / submission.bridge_id
        with folder_lock(partial, wait_s=_LOCK_WAIT_S):
            written.append(_into_manifest(submission, answers))
        remove_if_empty(partial.parent)
    return tuple(written)


def _into_manifest(submission: Submission, answers: Answers) -> Path:
    path = submission.folder / MANIFEST
    document = read_document(path)
    old = manifest_from_document(dict(document), where=path).info
    bridge = info_to_document(info_of(answers, submission.bridge_id))
    # The folder's name may differ from the id inside: `validate` says so, this must not hide it.
    bridge["bridge_id"] = old.bridge_id
    document["contribution"] = bridge.pop("contribution")
    document["bridge"] = bridge
    write_document(path, document, kind="manifest")
    return path
