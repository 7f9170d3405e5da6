"""Does a converter keep its promises? The conformance suite for ours and for everybody's.

``check_recording`` opens a recording, reads it in every way a build does, and returns what does not
hold; a test of a converter is one line: ``assert check_recording(open_recording, path) == ()``.
"""

from __future__ import annotations

import gc
import multiprocessing
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.validation.recording_files import (
    damaged_files,
    missing_files,
    open_files,
    sources_as_they_are,
)
from civil_rgbd.validation.recording_memory import kept_bytes
from civil_rgbd.validation.recording_reads import Sample, digests, images_fit, scans_fit
from civil_rgbd.validation.recording_shape import names_fit, notes_fit, shape_fits, stamps_fit

OpenRecording = Callable[[str | Path, RecordingOptions], Recording]
"""What a converter offers under its entry point."""

RULES: Final = {
    "opens": "open the recording, or raise a CivilRgbdError that says what, where and the fix",
    "shape": "see civil_rgbd.domain.recording.Recording for names, types and dtypes",
    "stamps": "give header stamps as int64 nanoseconds, in message order, poses over the same time",
    "notes": "see civil_rgbd.domain.recording.RecordingNotes",
    "sources": "list every file that was read, by name without folders, with its size and sha256; "
    "many files of a folder as one, by civil_rgbd.domain.folders.folder_source",
    "scans": "give points as recorded, their stamps within point_reach_ns of the header's",
    "images": "give pixels as recorded, of the size that rig.camera has",
    "repeatable": "reading must not depend on what was read before",
    "pickle": "make it picklable: paths and arrays travel, open files and payloads do not",
    "process": "open files when first read, in whatever process that is; use no globals",
    "errors": "raise nothing but CivilRgbdError for a file that is missing, cut or something else",
    "open-files": "close files after opening, and when the recording goes",
    "memory": "keep a few messages at most: a recording is larger than memory",
}
"""What is checked, and what to do where it does not hold."""

_PICKLE_BYTES: Final = 1 << 20
_PICKLE_BYTES_A_ROW: Final = 256


@dataclass(frozen=True, slots=True)
class Fault:
    """A promise that a converter does not keep.

    Attributes:
        rule: key of :data:`RULES`.
        message: what was found, with values.
    """

    rule: str
    message: str

    @property
    def fix(self) -> str:
        """What to do about it."""
        return RULES[self.rule]


def check_recording(
    open_recording: OpenRecording,
    location: str | Path,
    options: RecordingOptions | None = None,
    *,
    at_most: int = 100,
    other_process: bool = True,
    spare_bytes: int = 1 << 26,
) -> tuple[Fault, ...]:
    """Check a converter on one recording of its kind.

    Args:
        open_recording: the converter.
        location: a recording that it opens; small ones check faster.
        options: what the recording does not say itself.
        at_most: scans, and images, that are read; spread over the recording.
        other_process: also read it in a process that was spawned; classes must be importable there.
        spare_bytes: that may stay in memory after reading, whatever the recording's size.

    Returns:
        what does not hold; empty for a converter that keeps its promises.
    """
    options = options or RecordingOptions()
    suite = _Suite(open_recording, location, options, at_most, spare_bytes)
    rules = [("opens", suite.opens), *suite.on_the_recording()]
    if other_process:
        rules.append(("process", suite.other_process))
    rules += [("errors", suite.errors), ("open-files", suite.leaves_nothing_open)]
    found: list[Fault] = []
    for rule, check in rules:
        found += [Fault(rule, message) for message in _messages(check)]
        if found and rule in {"opens", "shape"}:
            break  # what follows needs them
    return tuple(found)


def _messages(check: Callable[[], Iterator[str]]) -> Iterator[str]:
    try:
        yield from check()
    except CivilRgbdError as error:
        yield f"raises {type(error).__name__}: {error.what}"
    except Exception as error:  # noqa: BLE001 - whatever a converter raises is a finding
        yield f"raises {type(error).__name__}: {error}"


class _Suite:
    def __init__(
        self,
        open_recording: OpenRecording,
        location: str | Path,
        options: RecordingOptions,
        at_most: int,
        spare_bytes: int,
    ) -> None:
        self._open_recording, self._location, self._options = open_recording, location, options
        self._at_most, self._spare_bytes = at_most, spare_bytes
        self._recording: Recording | None = None
        self._expected: list[str] = []

    def opens(self) -> Iterator[str]:
        before = open_files()
        self._recording = self._open_recording(self._location, self._options)
        for path in sorted(open_files() - before):
            yield f"{path} is still open after opening the recording"

    def on_the_recording(self) -> list[tuple[str, Callable[[], Iterator[str]]]]:
        """Return the rules that need nothing but an open recording, cheapest first."""
        return [
            ("shape", lambda: shape_fits(self._opened)),
            ("stamps", lambda: stamps_fit(self._opened)),
            ("notes", lambda: notes_fit(self._opened)),
            ("sources", lambda: names_fit(self._opened)),
            ("sources", lambda: sources_as_they_are(self._opened, self._location, self._options)),
            ("scans", lambda: scans_fit(self._opened, self._sample.scans)),
            ("images", lambda: images_fit(self._opened, self._sample.images)),
            ("repeatable", self.repeatable),
            ("pickle", self.pickle),
            ("memory", lambda: kept_bytes(self._opened, self._sample, self._spare_bytes)),
        ]

    @property
    def _opened(self) -> Recording:
        if self._recording is None:
            raise RuntimeError("the recording is opened first")
        return self._recording

    @property
    def _sample(self) -> Sample:
        return Sample.of(self._opened, self._at_most)

    def repeatable(self) -> Iterator[str]:
        self._expected = digests(self._opened, self._sample)
        again = digests(self._opened, self._sample)
        yield from _differences(self._expected, again, "read a second time")
        backwards = digests(self._opened, self._sample.reversed())
        yield from _differences(self._expected, backwards, "read from back to front")
        anew = self._open_recording(self._location, self._options)
        yield from _differences(self._expected, digests(anew, self._sample), "opened anew")

    def pickle(self) -> Iterator[str]:
        data = pickle.dumps(self._opened)
        rows = len(self._opened.image_stamps_ns) + len(self._opened.scan_stamps_ns)
        rows += len(self._opened.trajectory.stamps_ns)
        if len(data) > _PICKLE_BYTES + _PICKLE_BYTES_A_ROW * rows:
            yield f"it pickles to {len(data)} bytes: payloads travel along"
        travelled = pickle.loads(data)  # noqa: S301 - our own bytes
        found = digests(travelled, self._sample)
        yield from _differences(self._expected, found, "read after pickling")

    def other_process(self) -> Iterator[str]:
        context = multiprocessing.get_context("spawn")
        try:
            with ProcessPoolExecutor(max_workers=1, mp_context=context) as pool:
                found = pool.submit(digests, self._opened, self._sample).result()
        except BrokenProcessPool:
            yield "the process that read it died"
            return
        yield from _differences(self._expected, found, "read in another process")

    def errors(self) -> Iterator[str]:
        yield from missing_files(self._open_recording, self._location, self._options)
        yield from damaged_files(self._open_recording, self._location, self._options)

    def leaves_nothing_open(self) -> Iterator[str]:
        before = open_files()
        recording = self._open_recording(self._location, self._options)
        digests(recording, self._sample.first())
        del recording
        gc.collect()
        for path in sorted(open_files() - before):
            yield f"{path} is still open after the recording went"


def _differences(expected: list[str], found: list[str], when: str) -> Iterator[str]:
    differing = [one.rpartition(" ")[0] for one in expected if one not in set(found)]
    if differing:
        yield f"{len(differing)} messages differ when {when}, first {differing[0]}"
