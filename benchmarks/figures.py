"""Figures of a benchmark: printed with PASS or MISS, and kept as JSON and CSV."""

from __future__ import annotations

import csv
import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("civil-rgbd", "numpy", "torch", "transformers", "opencv-python-headless", "OpenEXR")


@dataclass(frozen=True, slots=True)
class Figure:
    """One number that was measured.

    Attributes:
        name: what it is, with its unit.
        value: of it; None where it could not be measured, and ``told`` says why.
        wanted: the target; None for what is only reported.
        at_most: whether smaller is better; else larger is.
        told: what it was measured with: seeds, frames, times.
    """

    name: str
    value: float | None
    wanted: float | None = None
    at_most: bool = True
    told: Mapping[str, object] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """PASS, MISS, or a dash for what has no target."""
        if self.wanted is None:
            return "-"
        if self.value is None:
            return "MISS"
        reached = self.value <= self.wanted if self.at_most else self.value >= self.wanted
        return "PASS" if reached else "MISS"


class Figures:
    """All figures of a folder, in ``figures.json`` and ``figures.csv``; new ones replace old.

    Args:
        folder: where the files are; it exists.
    """

    def __init__(self, folder: Path) -> None:
        self._json, self._csv = folder / "figures.json", folder / "figures.csv"
        known = json.loads(self._json.read_text("utf-8"))["figures"] if self._json.exists() else []
        self._known = {one["name"]: one for one in known}

    def add(self, figure: Figure) -> None:
        """Print a figure, and write all."""
        shown = "not measured" if figure.value is None else f"{figure.value:.4g}"
        sign = "at most" if figure.at_most else "at least"
        wanted = "" if figure.wanted is None else f", wanted {sign} {figure.wanted:g}"
        told = ", ".join(f"{name} {value}" for name, value in figure.told.items())
        print(f"{figure.verdict:4} {figure.name}: {shown}{wanted} ({told})", flush=True)
        self._known[figure.name] = asdict(figure) | {"verdict": figure.verdict}
        self._write()

    def value(self, name: str) -> float | None:
        """Return what was measured before; None for nothing."""
        value: float | None = self._known.get(name, {}).get("value")
        return value

    @property
    def missed(self) -> list[str]:
        """Names of the figures that miss their target."""
        return [name for name, one in self._known.items() if one["verdict"] == "MISS"]

    def _write(self) -> None:
        versions = {}
        for name in PACKAGES:
            try:
                versions[name] = version(name)
            except PackageNotFoundError:
                versions[name] = None
        document = {
            "machine": f"{platform.machine()}, Python {platform.python_version()}",
            "versions": versions,
            "figures": list(self._known.values()),
        }
        _replace(self._json, json.dumps(document, indent=1, default=str) + "\n")
        partial = self._csv.with_suffix(".partial")
        with partial.open("w", encoding="utf-8", newline="") as stream:
            table = csv.writer(stream, lineterminator="\n")
            table.writerow(("name", "value", "wanted", "at_most", "verdict", "told"))
            for one in self._known.values():
                told = json.dumps(one["told"], default=str)
                table.writerow(
                    [*(one[k] for k in ("name", "value", "wanted", "at_most", "verdict")), told]
                )
        partial.replace(self._csv)


def _replace(path: Path, text: str) -> None:
    partial = path.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
