"""The front door is short and costs nothing."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import civil_rgbd

HEAVY = {
    "OpenEXR",
    "cv2",
    "embreex",
    "jsonschema",
    "llvmlite",
    "mcap",
    "numba",
    "numpy",
    "pyarrow",
    "scipy",
    "torch",
    "tqdm",
    "trimesh",
}


def heavy_modules_after(code: str) -> set[str]:
    """Run code in a fresh interpreter and return the heavy packages that it imported."""
    report = "import sys, json; print(); print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True
    )
    modules = json.loads(done.stdout.splitlines()[-1])
    return HEAVY & {name.partition(".")[0] for name in modules}


def test_all_is_what_is_there() -> None:
    public = {name for name in vars(civil_rgbd) if not name.startswith("_")}

    assert civil_rgbd.__all__ == sorted(civil_rgbd.__all__)
    # What else is there: rooms that were imported, and the tools of the door itself.
    rooms = {name for name in public if f"civil_rgbd.{name}" in sys.modules}
    assert public - rooms - set(civil_rgbd.__all__) <= {"TYPE_CHECKING"}


@pytest.mark.parametrize("name", civil_rgbd.__all__)
def test_every_public_name_can_be_had(name: str) -> None:
    if name.startswith("Bridge"):
        pytest.importorskip("torch", reason="needs the extra [torch]")

    assert getattr(civil_rgbd, name) is not None


def test_other_names_cannot_be_had() -> None:
    with pytest.raises(AttributeError, match="'civil_rgbd' has no attribute 'BridgeDatset'"):
        civil_rgbd.BridgeDatset  # noqa: B018  # that it raises is the test


def test_importing_the_package_costs_nothing() -> None:
    assert heavy_modules_after("import civil_rgbd") == set()


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["no-such-command"]]
    + [[name, "--help"] for name in ("build", "info", "recipes", "simulate", "validate")],
)
def test_asking_the_command_line_for_help_costs_nothing(arguments: list[str]) -> None:
    code = f"from civil_rgbd.cli import main\nmain({arguments!r})"

    assert heavy_modules_after(code) == set()


def test_opening_recordings_and_building_need_no_torch() -> None:
    code = "import civil_rgbd.converters, civil_rgbd.builder.run, civil_rgbd.validation"

    assert "torch" not in heavy_modules_after(code)


def test_the_watch_itself_sees_what_is_imported() -> None:
    assert "numpy" in heavy_modules_after("import civil_rgbd.geometry.camera")
