"""A checked recording, told as a table or as JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from civil_rgbd.health.checks import Figure
from civil_rgbd.health.findings import Finding

_MARKS: Final = {"fit": "ok", "finding": "FINDING", "not observable": "-"}
_WIDTH: Final = 100
_NOT_YET: Final = ("no-poses", "pose-of-unknown")


@dataclass(frozen=True, slots=True)
class CheckReport:
    """What was measured of a recording.

    Attributes:
        name: of the recording.
        seconds: its length.
        figures: everything that was measured, in order.
        lacks: what a build misses; poses may be computed later, all else makes it unfit.
        remarks: what is odd though nothing is lost.
    """

    name: str
    seconds: float
    figures: tuple[Figure, ...]
    lacks: tuple[Finding, ...] = ()
    remarks: tuple[Finding, ...] = ()

    @property
    def found(self) -> tuple[Figure, ...]:
        """The figures beyond their limits."""
        return tuple(figure for figure in self.figures if figure.found)

    @property
    def missing(self) -> tuple[Finding, ...]:
        """What a build misses, and nobody can compute later."""
        return tuple(finding for finding in self.lacks if finding.code not in _NOT_YET)

    @property
    def fit(self) -> bool:
        """Whether there is nothing to do before leaving."""
        return not self.found and not self.missing

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return {
            "name": self.name,
            "seconds": self.seconds,
            "fit": self.fit,
            "findings": [figure.code for figure in self.found]
            + [finding.code for finding in self.missing],
            "figures": [figure.to_document() for figure in self.figures],
            "lacks": [finding.to_document() for finding in self.lacks],
            "remarks": [finding.to_document() for finding in self.remarks],
        }

    def to_text(self) -> str:
        """Return it for people."""
        return "\n".join([
            f"{self.name}: {self.seconds:.1f} s",
            *_table(self.figures),
            *_findings(self.found),
            *_others(self.lacks, "lacks"),
            *_others(self.remarks, "note"),
            self._verdict(),
        ])  # fmt: skip

    def _verdict(self) -> str:
        count = len(self.found) + len(self.missing)
        unknown = sum(figure.value is None for figure in self.figures)
        rest = f"; {unknown} of {len(self.figures)} figures cannot be observed" if unknown else ""
        if not count:
            return f"fit: no findings{rest}"
        return f"not fit: {count} finding{'s' if count > 1 else ''}{rest}"


def _table(figures: tuple[Figure, ...]) -> Iterator[str]:
    for figure in figures:
        if figure.value is None:
            line = f"  {_MARKS[figure.state]:8}{figure.code:18} not observable"
        else:
            line = f"  {_MARKS[figure.state]:8}{figure.code:18} {_said(figure)}"
        yield from textwrap.wrap(
            f"{line}: {figure.detail}" if figure.detail else line,
            _WIDTH,
            subsequent_indent=" " * 29,
        )


def _said(figure: Figure) -> str:
    check = figure.check
    unit = f" {check.unit}" if check.unit else ""
    doubt = f" +- {figure.sigma:.2g}" if figure.sigma is not None else ""
    bound = "at least" if check.at_least else "at most"
    return f"{figure.value:.3g}{doubt}{unit} ({bound} {check.limit:g})"


def _findings(found: tuple[Figure, ...]) -> Iterator[str]:
    for figure in found:
        yield f"finding: {figure.code}: {figure.check.what}: {_said(figure)}"
        yield f"  fix: {figure.fix}"


def _others(findings: tuple[Finding, ...], word: str) -> Iterator[str]:
    for finding in findings:
        yield f"{word}: {finding.code}: {finding.message}"
        yield f"  {'fix' if word == 'lacks' else 'note'}: {finding.fix}"
