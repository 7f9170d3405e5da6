"""What a check found, and how it is told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

_REBUILD: Final = "build the bridge again, or download it again"
_ANSWER: Final = "`civil-rgbd new-bridge ID --out DATASET` asks for it"
_SHOWN: Final = 3  # findings of one code in the text; --json gives them all

CODES: Final = {
    "bridge-id-mismatch": ("error", "rename the folder, or set bridge_id in manifest.json"),
    "bridge-ids-alike": ("error", "rename one: some systems take both for one folder"),
    "contribution-calibration": (
        "error",
        "say how, when and how well the camera was calibrated to the LiDAR: " + _ANSWER,
    ),
    "contribution-citation": ("error", "say how the data is to be cited: " + _ANSWER),
    "contribution-consent": (
        "error",
        "name the owner, and say how and in what words they agreed: " + _ANSWER,
    ),
    "contribution-contact": ("error", "give an e-mail address or a web page: " + _ANSWER),
    "contribution-dates": ("error", "say on which days the scan was taken: " + _ANSWER),
    "contribution-dates-stamps": (
        "warning",
        "right where the recorder's clock was wrong; otherwise mend survey_dates",
    ),
    "contribution-licence": (
        "error",
        "choose one licence for data by its SPDX id, for example CC-BY-4.0: " + _ANSWER,
    ),
    "contribution-place": (
        "error",
        "say where it stands, as precisely as the owner allows and no more: " + _ANSWER,
    ),
    "contribution-privacy": (
        "error",
        "say what was done about faces and number plates, and how it was checked: " + _ANSWER,
    ),
    "contribution-rig": (
        "error",
        "name LiDAR and camera: `sensors` in words, and [sensors] of the rig file in a build",
    ),
    "contribution-structure": ("error", "say what stands there, and since when: " + _ANSWER),
    "counts-mismatch": ("error", _REBUILD),
    "dataset-bridge-missing": (
        "error",
        "bring the bridge back, or take it out of `bridges` in dataset.json",
    ),
    "dataset-bridge-unlisted": ("error", "add it to `bridges` in dataset.json; a build does so"),
    "defect-duplicate": ("error", "give each defect an id of its own"),
    "defect-frame-unknown": ("error", "name a frame of this bridge, or delete the defect"),
    "depth-negative": ("error", _REBUILD),
    "depth-not-finite": ("error", _REBUILD),
    "depth-off-step": ("error", "build again, or round to the recipe's depth.step_m"),
    "depth-out-of-range": ("error", "build again, or with other depth.min_m and depth.max_m"),
    "depth-pixel-hash": ("error", "the pixels are not those that were built: " + _REBUILD),
    "depth-size": ("error", _REBUILD),
    "depth-statistics": ("error", _REBUILD),
    "depth-unreadable": ("error", _REBUILD),
    "document-missing": ("error", _REBUILD),
    "document-schema": ("error", "mend the place; docs/format.md explains every key"),
    "document-unreadable": ("error", _REBUILD),
    "document-value": ("error", "mend the value; docs/format.md explains every key"),
    "file-hash": ("error", "the file is not the one that was built: " + _REBUILD),
    "file-litter": ("warning", "delete the file: a file manager left it there"),
    "file-missing": ("error", _REBUILD),
    "file-unknown": ("error", "take the file out: a bridge folder holds nothing else"),
    "frame-id-duplicate": ("error", _REBUILD),
    "frame-id-mismatch": ("error", "the id is the image's index in six digits: " + _REBUILD),
    "frame-id-order": ("error", _REBUILD),
    "index-path": ("error", _REBUILD),
    "index-unreadable": ("error", _REBUILD),
    "intrinsics-principal-point": (
        "warning",
        "right for a cropped image; otherwise check cx_px and cy_px",
    ),
    "intrinsics-recipe": (
        "error",
        "the camera is not the rig's at the recipe's scale: check both, or build again",
    ),
    "licence-unstated": (
        "warning",
        "build with --licence SPDX or --bridge-info bridge.toml; nobody may use it otherwise",
    ),
    "machine-path": ("error", "take the path or host out: it says nothing on other machines"),
    "manifest-missing": (
        "error",
        "the bridge is unfinished: start its build again, download it again, or delete it",
    ),
    "pose-mismatch": ("error", "poses.json is the law: write frames.parquet anew from it"),
    "poses-frames": ("error", _REBUILD),
    "quaternion-norm": ("error", "scale the quaternion to norm 1"),
    "quaternion-sign": ("error", "turn the signs of all four components round"),
    "recipe-hash": ("error", "the parameters are not those that the hash was taken of"),
    "quality-pixel-hash": ("error", "the pixels are not those that were built: " + _REBUILD),
    "quality-planes": ("error", _REBUILD),
    "quality-size": ("error", _REBUILD),
    "quality-unreadable": ("error", _REBUILD),
    "quality-values": ("error", _REBUILD),
    "rgb-decoder": (
        "warning",
        "the file is as built; your JPEG decoder gives other pixels than the builder's",
    ),
    "rgb-pixel-hash": ("error", "the pixels are not those that were built: " + _REBUILD),
    "rgb-size": ("error", _REBUILD),
    "rgb-unreadable": ("error", _REBUILD),
    "split-bridge-unknown": ("error", "bring the bridge back, or take it out of the split"),
    "split-frame-unknown": ("error", "take the frame out of the split"),
    "stamp-offset": ("error", _REBUILD),
    "stamp-order": ("error", _REBUILD),
    "version-newer": ("warning", "a newer civil-rgbd checks the keys that were ignored"),
    "version-unsupported": ("error", "check with the release of civil-rgbd that wrote it"),
}
"""Level and remedy of every finding, by code. Codes are stable: scripts may rely on them."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, or odd.

    Attributes:
        code: key of :data:`CODES`.
        message: what is there and what should be, with values.
        file: relative to the bridge folder, or to the dataset where ``bridge`` is None.
        bridge: the bridge's folder name; None for the dataset itself.
    """

    code: str
    message: str
    file: str
    bridge: str | None = None

    @property
    def level(self) -> str:
        """``error`` or ``warning``."""
        return CODES[self.code][0]

    @property
    def fix(self) -> str:
        """What to do about it."""
        return CODES[self.code][1]

    @property
    def place(self) -> str:
        """Bridge and file."""
        return self.file if self.bridge is None else f"{self.bridge}/{self.file}"

    def to_document(self) -> dict[str, str | None]:
        """Return it for machines."""
        return {
            "code": self.code,
            "level": self.level,
            "bridge": self.bridge,
            "file": self.file,
            "message": self.message,
            "fix": self.fix,
        }


@dataclass(frozen=True, slots=True)
class Report:
    """All that was found in one place.

    Attributes:
        location: the folder, as it was given.
        bridges: the bridges that were looked at.
        frames: how many frames were looked at.
        findings: everything, in the order of the check.
    """

    location: str
    bridges: tuple[str, ...]
    frames: int
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> int:
        """How many findings are errors."""
        return sum(finding.level == "error" for finding in self.findings)

    @property
    def warnings(self) -> int:
        """How many findings are warnings."""
        return len(self.findings) - self.errors

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return {
            "location": self.location,
            "bridges": list(self.bridges),
            "frames": self.frames,
            "errors": self.errors,
            "warnings": self.warnings,
            "findings": [finding.to_document() for finding in self.findings],
        }

    def to_text(self) -> str:
        """Return it for people: by code with a count, errors first, a few of each."""
        checked = f"{_many(len(self.bridges), 'bridge')}, {_many(self.frames, 'frame')} checked"
        lines = [f"{self.location}: {checked}"]
        by_code = sorted(self.findings, key=lambda finding: (finding.level, finding.code))
        for _, group in groupby(by_code, key=lambda finding: finding.code):
            lines += _group_lines(list(group))
        lines.append(
            f"{_many(self.errors, 'error')}, {_many(self.warnings, 'warning')}"
            if self.findings
            else "nothing to complain of"
        )
        return "\n".join(lines)


def _group_lines(findings: Sequence[Finding]) -> Iterator[str]:
    first = findings[0]
    bridges = Counter(finding.bridge for finding in findings)
    spread = f" in {len(bridges)} bridges" if len(bridges) > 1 else ""
    yield f"{first.level}: {first.code}, {_many(len(findings), 'time')}{spread}"
    # Each gap of a contribution is a question of its own: none is left out.
    shown = len(findings) if first.code.startswith("contribution-") else _SHOWN
    for finding in findings[:shown]:
        yield f"  {finding.place}: {finding.message}"
    if len(findings) > shown:
        yield f"  ... and {len(findings) - shown} more (--json gives them all)"
    yield f"  fix: {first.fix}"


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
