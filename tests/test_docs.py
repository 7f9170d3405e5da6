"""What the pages promise: code blocks run, files named are there, words are those of the code.

A block that does not run says why in its first line: ``sh not run: needs a recording of yours``.
Blocks of one page run in order, in one empty folder; Python blocks share their names.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
)
PROGRAMS = {"python", "sh"}
DATA = {"json", "toml", "text", "bibtex"}
NOT_RUN = re.compile(r"not run: \S.{5,}")


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes:
        page: relative to the repository.
        line: of the opening fence.
        language: first word behind the fence.
        remark: what follows it.
        text: what stands between the fences.
    """

    page: str
    line: int
    language: str
    remark: str
    text: str

    @property
    def runs(self) -> bool:
        return self.language in PROGRAMS and not self.remark


def blocks_of(page: str) -> list[Block]:
    blocks, opened, inside = [], None, []
    for number, line in enumerate((ROOT / page).read_text("utf-8").splitlines(), 1):
        if line.startswith("```") and opened is None:
            language, _, remark = line[3:].strip().partition(" ")
            opened, inside = (number, language, remark), []
        elif line.startswith("```") and opened is not None:
            blocks.append(Block(page, *opened, "\n".join(inside) + "\n"))
            opened = None
        elif opened is not None:
            inside.append(line)
    assert opened is None, f"{page}:{opened} opens a block that never ends"
    return blocks


BLOCKS = [block for page in PAGES for block in blocks_of(page)]
RUNNING_PAGES = sorted({block.page for block in BLOCKS if block.runs})


def test_the_pages_with_programs_are_found() -> None:
    assert {"README.md", "docs/tutorials/first_build.md"} <= set(RUNNING_PAGES)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: f"{block.page}:{block.line}")
def test_a_block_runs_or_is_data_or_says_why_not(block: Block) -> None:
    if block.remark:
        assert NOT_RUN.fullmatch(block.remark), "say: not run: and the reason"
    else:
        assert block.language in PROGRAMS | DATA, "name its language, or say why it does not run"


@pytest.mark.parametrize(
    "block",
    [block for block in BLOCKS if block.language in {"json", "toml"}],
    ids=lambda block: f"{block.page}:{block.line}",
)
def test_a_block_of_data_can_be_parsed(block: Block) -> None:
    parsed = (json.loads if block.language == "json" else tomllib.loads)(block.text)

    assert isinstance(parsed, dict)


def run_page(page: str, folder: Path) -> None:
    names: dict[str, Any] = {"__name__": "__page__"}
    for block in blocks_of(page):
        if not block.runs:
            continue
        place = f"{page}:{block.line}"
        if block.language == "python":
            # Blank lines before it, so that a traceback names the line of the page.
            code = compile("\n" * block.line + block.text, str(ROOT / page), "exec")
            exec(code, names)  # noqa: S102 - our own pages
        else:
            scripts = str(Path(sys.executable).parent)
            environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
            done = subprocess.run(
                ["sh", "-ec", block.text],  # noqa: S607 - whichever sh the reader has
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=600,
            )
            assert done.returncode == 0, f"{place}\n{done.stdout}\n{done.stderr}"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="the pages speak to a POSIX shell")
@pytest.mark.parametrize("page", RUNNING_PAGES)
def test_the_programs_of_a_page_run(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    run_page(page, tmp_path)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings_that_are_there(page: str) -> None:
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text("utf-8"), flags=re.DOTALL)
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = ((ROOT / page).parent / name) if name else ROOT / page
        if not path.exists() or (anchor and anchor not in anchors_of(path)):
            broken.append(target)

    assert not broken


def anchors_of(path: Path) -> set[str]:
    """Anchors as GitHub makes them: lower case, no punctuation, hyphens for spaces."""
    headings = re.findall(r"^#+ (.*)$", path.read_text("utf-8"), flags=re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings
    }


def test_every_command_and_recipe_is_in_the_readme() -> None:
    from civil_rgbd.cli import COMMANDS
    from civil_rgbd.resources import recipe_texts

    readme = (ROOT / "README.md").read_text("utf-8")

    assert [name for name in COMMANDS if f"| `civil-rgbd {name}`" not in readme] == []
    assert [name for name in recipe_texts() if f"`{name}`" not in readme] == []


def test_every_option_that_a_page_names_is_one() -> None:
    import importlib

    from civil_rgbd.cli import COMMANDS

    known = {"--help", "--version"}
    for name in COMMANDS:
        command = importlib.import_module(f"civil_rgbd.cli.{name.replace('-', '_')}").command
        for one in (command, *getattr(command, "commands", {}).values()):
            known |= {option for parameter in one.params for option in parameter.opts}
    strangers = {"--check", "--strict", "--config-file", "--no-deps", "--target"}  # ruff, mypy, pip
    strangers |= {"--dependency", "--host", "--port", "--nworkers", "--nthreads"}  # sbatch, dask
    strangers |= {"--no-dashboard", "--scheduler-file"}  # dask
    strangers |= {"--nproc-per-node"}  # torchrun
    strangers |= {"--plain"}  # benchmarks/quality.py
    for page in PAGES:
        text = re.sub(r"```text.*?```", "", (ROOT / page).read_text("utf-8"), flags=re.DOTALL)
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) - strangers
        assert named <= known, page


def test_every_decision_is_in_the_index_and_numbered_once() -> None:
    decisions = ROOT / "docs" / "decisions"
    pages = sorted(path.name for path in decisions.glob("[0-9]*.md"))
    index = (decisions / "README.md").read_text("utf-8")

    assert pages == sorted(re.findall(r"\]\(([0-9]{4}-[^)]+\.md)\)", index))
    assert len({name[:4] for name in pages}) == len(pages)


def test_the_half_pixel_page_has_the_figures_of_the_code() -> None:
    from civil_rgbd.geometry.camera import PinholeCamera

    page = (ROOT / "docs/decisions/0006-half-pixel-rule.md").read_text("utf-8")
    stored = PinholeCamera(1280, 720, 636.52, 634.79, 635.6729736328125, 366.147705078125).scaled(
        0.6
    )

    assert f"| cx | 635.673 | {635.6729736328125 * 0.6:.3f} | {stored.cx_px:.3f} |" in page
    assert f"| cy | 366.148 | {366.147705078125 * 0.6:.3f} | {stored.cy_px:.3f} |" in page


def test_the_datasheet_answers_every_section() -> None:
    text = (ROOT / "DATASHEET.md").read_text("utf-8")
    sections = dict(
        re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, flags=re.DOTALL | re.MULTILINE)
    )
    questions = {name: body.split("\n### ")[1:] for name, body in sections.items()}

    assert {name: len(found) for name, found in questions.items()} == {
        "Motivation": 4,
        "Composition": 16,
        "Collection process": 12,
        "Preprocessing, cleaning, labelling": 4,
        "Uses": 6,
        "Distribution": 7,
        "Maintenance": 8,
    }
    for found in questions.values():
        for question in found:
            heading, _, answer = question.partition("\n")
            assert answer.strip(), heading


def test_the_citation_is_that_of_the_readme() -> None:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    readme = (ROOT / "README.md").read_text("utf-8")

    for word in ("10.1177/14759217251316532", "Midwinter", "Al-Sabbag", "Bajaj", "Yeum", "2025"):
        assert word in citation
        assert word in readme


def test_the_version_is_the_same_everywhere() -> None:
    import civil_rgbd

    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text("utf-8")

    assert project["version"] == civil_rgbd.__version__
    assert f"version: {civil_rgbd.__version__}\n" in citation
    assert civil_rgbd.__version__ in (ROOT / "CHANGELOG.md").read_text("utf-8")
