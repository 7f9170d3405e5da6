"""Which frames train and which are scored; as a file, anyone can use the same."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from civil_rgbd.errors import FormatError

SPLIT_VERSION: Final = 1
"""Of the split files that this release writes."""

FramesOf = Mapping[str, tuple[str, ...]]
"""Frame ids by bridge id."""


@dataclass(frozen=True, slots=True)
class Split:
    """Frames to train with, and frames to score.

    Attributes:
        train: frame ids by bridge.
        tests: sets of frames to score, by name; the first is the headline.
        origin: how it was drawn, such as test bridge, shots and seed; for people.
    """

    train: FramesOf
    tests: Mapping[str, FramesOf]
    origin: Mapping[str, str | int | float] = field(default_factory=dict)

    def to_document(self) -> dict[str, Any]:
        """Turn it into the document that :func:`split_from_document` reads."""
        return {
            "civil_rgbd_split": SPLIT_VERSION,
            "origin": dict(self.origin),
            "train": _lists(self.train),
            "tests": {name: _lists(frames) for name, frames in self.tests.items()},
        }

    def sha256(self) -> str:
        """Return the hash of all frames, lower-case hex; how they were drawn does not enter it."""
        document = self.to_document()
        frames = json.dumps([document["train"], document["tests"]], separators=(",", ":"))
        return hashlib.sha256(frames.encode()).hexdigest()

    def scored(self) -> FramesOf:
        """Return every frame of any test, by bridge, each once, in order."""
        ids: dict[str, set[str]] = {}
        for frames in self.tests.values():
            for bridge, some in frames.items():
                ids.setdefault(bridge, set()).update(some)
        return {bridge: tuple(sorted(ids[bridge])) for bridge in sorted(ids)}


def _lists(frames: FramesOf) -> dict[str, list[str]]:
    return {bridge: sorted(frames[bridge]) for bridge in sorted(frames)}


def split_from_document(document: Mapping[str, Any], *, where: object) -> Split:
    """Turn a parsed split file into what it says.

    Raises:
        FormatError: it is no split file, or a frame is trained with and scored.
    """
    for fault in _faults(document):
        raise FormatError(
            f"this is no split file: {fault}",
            where=where,
            fix="write one with `civil-rgbd benchmark` or `civil-rgbd train`, or after its example",
        )
    split = Split(
        train=_tuples(document["train"]),
        tests={name: _tuples(frames) for name, frames in document["tests"].items()},
        origin=document.get("origin", {}),
    )
    for bridge, ids in split.scored().items():
        both = sorted(set(ids).intersection(split.train.get(bridge, ())))
        if both:
            raise FormatError(
                f"{len(both)} frames of bridge {bridge!r} are trained with and scored, "
                f"the first is {both[0]!r}",
                where=where,
                fix="take them out of train or out of tests",
            )
    return split


def _tuples(frames: Mapping[str, list[str]]) -> dict[str, tuple[str, ...]]:
    return {bridge: tuple(sorted(frames[bridge])) for bridge in sorted(frames)}


def _faults(document: Mapping[str, Any]) -> Iterator[str]:
    if "civil_rgbd_split" not in document:
        yield "it has no key 'civil_rgbd_split'"
        return
    if document["civil_rgbd_split"] != SPLIT_VERSION:
        version = document["civil_rgbd_split"]
        yield f"its version is {version!r}, and this release reads {SPLIT_VERSION}"
    if not isinstance(document.get("origin", {}), dict):
        yield "'origin' is no object"
    tests = document.get("tests")
    if not isinstance(tests, dict):
        yield "'tests' is no object of sets of frames"
        return
    for name, frames in {"train": document.get("train"), **tests}.items():
        if not isinstance(frames, dict) or not all(map(_is_list_of_ids, frames.values())):
            yield f"{name!r} is not lists of different frame ids by bridge"


def _is_list_of_ids(ids: object) -> bool:
    return (
        isinstance(ids, list)
        and all(isinstance(one, str) for one in ids)
        and len(set(ids)) == len(ids)
    )
