"""The conformance suite: silent on our converters, loud on each broken promise."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import (
    CameraImage,
    Recording,
    RecordingNotes,
    RecordingOptions,
    SourceFile,
)
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import CivilRgbdError, ImageDecodeError
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.validation.recordings import RULES, Fault, check_recording

from ..conversion import containers, messages, scene

MESSAGES = scene.flat(scene.whole())


def write(folder: Path, kind: str) -> Path:
    if kind == "mcap":
        return scene.write(folder / "a.mcap", MESSAGES)
    if kind.startswith("bag"):
        _, _, compression = kind.partition("-")
        return containers.write_bag(folder / "a.bag", MESSAGES, compression=compression or "none")
    storage, _, compression = kind.partition("-")
    return containers.write_folder(
        folder / "a", MESSAGES, storage=storage, compression=compression or None
    )


KINDS = ["mcap", "bag", "bag-lz4", "bag-bz2", "sqlite3", "sqlite3-message", "sqlite3-file"]


@pytest.mark.parametrize("kind", [*KINDS, "mcap-folder", "db3"])
def test_our_converters_keep_their_promises(tmp_path: Path, kind: str) -> None:
    if kind == "mcap-folder":
        path = containers.write_folder(tmp_path / "a", MESSAGES, storage="mcap")
    elif kind == "db3":
        path = write(tmp_path, "sqlite3") / "a.db3"
    else:
        path = write(tmp_path, kind)

    assert check_recording(open_recording, path, other_process=kind in {"mcap", "bag-lz4"}) == ()


def test_several_files_keep_the_promises(tmp_path: Path) -> None:
    half = len(MESSAGES) // 2
    first = containers.write_bag(tmp_path / "a_0.bag", MESSAGES[:half])
    second = containers.write_bag(tmp_path / "a_1.bag", MESSAGES[half:], compression="lz4")
    options = RecordingOptions(more_files=(second,))

    found = check_recording(open_recording, first, options, other_process=False)

    assert found == ()


def test_the_simulator_keeps_the_promises() -> None:
    spec = ScanSpec(seconds=1.0, image_scale=0.05, point_rate_hz=3000)

    assert check_recording(lambda *_: SimulatedRecording(spec), "simulated:small", at_most=3) == ()


@pytest.mark.parametrize("name", ["kitti_bridge_drive/kitti_20frames.mcap"])
def test_a_real_recording_keeps_the_promises(shared_data: Path, name: str) -> None:
    found = check_recording(open_recording, shared_data / name, at_most=4, other_process=False)

    assert found == ()


@dataclass(frozen=True, eq=False)
class Bent:
    """A recording of ours, with one thing bent."""

    inner: Recording
    bend: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in {"inner", "bend"}:
            raise AttributeError(name)
        if name in self.bend:
            value = self.bend[name]
            if value is AttributeError:
                raise AttributeError(name)
            return value
        return getattr(self.inner, name)


def bent(path: Path, **bend: object) -> list[Fault]:
    """What the suite says of a recording that has other attributes."""

    def opener(location: str | Path, options: RecordingOptions) -> Recording:
        inner = open_recording(location, options)
        made = {
            name: value(inner) if callable(value) and not isinstance(value, type) else value
            for name, value in bend.items()
        }
        recording: Any = Bent(inner, made)
        return recording

    return list(check_recording(opener, path, at_most=5, other_process=False))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path, "mcap")


def test_a_recording_that_is_only_wrapped_keeps_the_promises(path: Path) -> None:
    assert bent(path) == []


def _made(read: object, what: dict[str, Any]) -> dict[str, Any]:
    return {name: value(read) if callable(value) else value for name, value in what.items()}


def _other_scan(**what: Any) -> Callable[[Recording], Callable[[int], LidarScan]]:
    def bend(inner: Recording) -> Callable[[int], LidarScan]:
        def read(index: int) -> LidarScan:
            scan = inner.read_scan(index)
            return replace(scan, **_made(scan, what))

        return read

    return bend


def _other_image(**what: Any) -> Callable[[Recording], Callable[[int], CameraImage]]:
    def bend(inner: Recording) -> Callable[[int], CameraImage]:
        def read(index: int) -> CameraImage:
            image = inner.read_image(index)
            made = {
                name: value(image) if callable(value) else value for name, value in what.items()
            }
            return replace(image, **made)

        return read

    return bend


def _stamps(scan: LidarScan) -> Any:
    return np.full(len(scan.points), scan.stamp_ns + 5, dtype=np.int64)


BROKEN: dict[str, tuple[str, str, dict[str, Any]]] = {
    "no trajectory": ("shape", "it has no trajectory", {"trajectory": AttributeError}),
    "a list of sources": ("shape", "sources is a list", {"sources": lambda r: list(r.sources)}),
    "float stamps": (
        "shape",
        "scan_stamps_ns is float64",
        {"scan_stamps_ns": lambda r: r.scan_stamps_ns.astype(float)},
    ),
    "read_scan is no method": ("shape", "no method read_scan", {"read_scan": 5}),
    "no images": ("stamps", "it has no images", {"image_stamps_ns": np.zeros(0, np.int64)}),
    "another clock": (
        "stamps",
        "no scans lie inside the trajectory",
        {"scan_stamps_ns": lambda r: r.scan_stamps_ns - scene.START_NS},
    ),
    "negative stamps": (
        "stamps",
        "before 1970",
        {"scan_stamps_ns": lambda r: r.scan_stamps_ns - 2 * scene.START_NS},
    ),
    "reach the wrong way round": ("stamps", "point_reach_ns", {"point_reach_ns": (5, -5)}),
    "reach in seconds": ("stamps", "whole nanoseconds", {"point_reach_ns": (0.0, 0.1)}),
    "reach too far": ("stamps", "longer|further", {"point_reach_ns": (0, 10**10)}),
    "unknown deskew": ("notes", "deskew is 'none'", {"notes": RecordingNotes(deskew="none")}),
    "deskew without point stamps": (
        "scans",
        "no stamps, but deskew is 'per_point'",
        {"notes": RecordingNotes(deskew="per_point")},
    ),
    "salvage says nothing": (
        "notes",
        "salvage is ''",
        {"notes": RecordingNotes(deskew="unavailable", salvage="")},
    ),
    "map_up is long": (
        "notes",
        "no unit vector",
        {"notes": RecordingNotes(deskew="unavailable", map_up=(0, 0, 2))},
    ),
    "a name with folders": ("sources", "with folders", {"name": "data/a"}),
    "a source with folders": (
        "sources",
        "with folders",
        {"sources": (SourceFile("/data/a.mcap", 1, "0", "mcap"),)},
    ),
    "no sources": ("sources", "names none", {"sources": ()}),
    "a source that is elsewhere": (
        "sources",
        "is no file at",
        {"sources": (SourceFile("b.mcap", 1, "0", "mcap"),)},
    ),
    "a wrong size": (
        "sources",
        "bytes, not 1",
        {"sources": (SourceFile("a.mcap", 1, "0", "mcap"),)},
    ),
    "a wrong checksum": (
        "sources",
        "sha256",
        {"sources": lambda r: (replace(r.sources[0], sha256="0" * 64),)},
    ),
    "a scan of another stamp": (
        "scans",
        "scan_stamps_ns says",
        {"read_scan": _other_scan(stamp_ns=lambda scan: scan.stamp_ns + 1)},
    ),
    "integer points": (
        "scans",
        "not float32 or float64",
        {"read_scan": _other_scan(points=lambda scan: scan.points.astype(np.int32))},
    ),
    "integer noise": (
        "scans",
        "not bool",
        {"read_scan": _other_scan(noise=lambda scan: np.zeros(len(scan.points), np.uint8))},
    ),
    "scans that are in the map without a word": (
        "scans",
        "in_map is True",
        {"read_scan": _other_scan(in_map=True)},
    ),
    "points out of reach": (
        "scans",
        r"stamped 5 to 5 ns after its header",
        {"read_scan": _other_scan(point_stamps_ns=_stamps)},
    ),
    "a scan that is an array": (
        "scans",
        "not a LidarScan",
        {"read_scan": lambda r: lambda index: r.read_scan(index).points},
    ),
    "an image of another number": (
        "images",
        "its index is 7",
        {"read_image": _other_image(index=7)},
    ),
    "an image of another stamp": (
        "images",
        "image_stamps_ns says",
        {"read_image": _other_image(source_stamp_ns=5)},
    ),
    "an image of another size": (
        "images",
        r"shape \(40, 64, 3\)",
        {"read_image": _other_image(rgb=lambda image: image.rgb[:40])},
    ),
    "an error of Python's": (
        "scans",
        "raises ZeroDivisionError",
        {"read_scan": lambda _: lambda index: index // 0},
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_promise_is_found(path: Path, name: str) -> None:
    rule, message, bend = BROKEN[name]

    found = bent(path, **bend)

    matching = [fault for fault in found if fault.rule == rule]
    assert matching, found
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("; ".join(fault.message for fault in matching))
    assert matching[0].fix == RULES[rule]


def test_a_scan_that_depends_on_what_was_read_before_is_found(path: Path) -> None:
    counter = itertools.count()
    drifting = _other_scan(points=lambda scan: scan.points + np.float32(next(counter)))

    found = bent(path, read_scan=drifting)

    assert {fault.rule for fault in found} >= {"repeatable"}
    assert any("read a second time" in fault.message for fault in found)
    assert any("from back to front" in fault.message for fault in found)


def test_what_cannot_be_pickled_is_found(path: Path) -> None:
    found = bent(path, read_scan=lambda inner: lambda index, *_: inner.read_scan(index))

    assert "pickle" in {fault.rule for fault in found}


def test_payloads_that_travel_are_found(path: Path) -> None:
    found = bent(path, luggage=np.zeros(5_000_000))

    assert [fault.rule for fault in found] == ["pickle"]
    assert "payloads travel along" in found[0].message


def test_memory_that_is_kept_is_found(path: Path) -> None:
    kept: list[object] = []

    def opener(location: str | Path, options: RecordingOptions) -> Recording:
        inner = open_recording(location, options)

        def read(index: int) -> LidarScan:
            kept.append(np.zeros(100_000))
            return inner.read_scan(index)

        recording: Any = Bent(inner, {"read_scan": read})
        return recording

    found = check_recording(opener, path, other_process=False, spare_bytes=1_000_000)

    assert "memory" in {fault.rule for fault in found}


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux tells open files")
def test_files_that_stay_open_are_found(path: Path) -> None:
    opened: list[BinaryIO] = []

    def opener(location: str | Path, options: RecordingOptions) -> Recording:
        opened.append(Path(location).open("rb"))  # noqa: SIM115 - left open: what is looked for
        return open_recording(location, options)

    found = check_recording(opener, path, other_process=False)
    for file in opened:
        file.close()

    assert [fault for fault in found if fault.rule == "opens" and "still open" in fault.message]


def test_errors_that_say_nothing_are_found(path: Path) -> None:
    def opener(location: str | Path, options: RecordingOptions) -> Recording:
        try:
            return open_recording(location, options)
        except CivilRgbdError as error:
            raise ValueError(error.what) from error

    found = check_recording(opener, path, other_process=False)

    assert {fault.rule for fault in found} == {"errors"}
    assert found[0].message.startswith("a file that is not there: raises ValueError")
    assert len(found) >= 4


def test_what_opens_anything_is_found(path: Path) -> None:
    whole = open_recording(path)

    found = check_recording(lambda *_: whole, path, other_process=False)

    assert [fault.message for fault in found] == [
        "a file that is not there opens as if it were a recording",
        "an empty file opens as if it were a recording",
        "a file of other content opens as if it were a recording",
    ]


def test_what_does_not_open_is_one_fault(tmp_path: Path) -> None:
    found = check_recording(open_recording, tmp_path / "missing.mcap")

    assert [fault.rule for fault in found] == ["opens"]
    assert "RecordingError: there is no such recording" in found[0].message


def test_a_process_that_reads_something_else_is_found(path: Path) -> None:
    class Local:
        """Cannot be imported by another process."""

    found = [
        fault
        for fault in check_recording(
            lambda *given: _with(open_recording(*given), Local()), path, at_most=2
        )
        if fault.rule in {"pickle", "process"}
    ]

    assert {fault.rule for fault in found} == {"pickle", "process"}


def _with(recording: Recording, luggage: object) -> Recording:
    carrying: Any = Bent(recording, {"luggage": luggage})
    return carrying


def test_an_image_that_cannot_be_decoded_is_the_builds_to_count(path: Path) -> None:
    parts = scene.whole()
    broken = messages.compressed_image(scene.stamp(3), scene.jpeg()[:-30])
    parts["images"][3] = parts["images"][3]._replace(payload=broken)
    file = scene.write(path.with_name("b.mcap"), parts)
    recording = open_recording(file)
    with pytest.raises(ImageDecodeError, match="end marker"):
        recording.read_image(3)

    assert check_recording(open_recording, file, other_process=False) == ()
