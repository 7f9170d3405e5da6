"""One way to get a model: by name, from a run, from a file of one's own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.baselines.bts_model import BtsModel
from civil_rgbd.baselines.model import (
    DepthModel,
    StoredDepth,
    load_model,
    model_names,
    predict_frame,
)
from civil_rgbd.errors import FormatError, MissingExtraError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera

FLAT = """
import numpy as np

class Flat:
    def __init__(self, depth_m=4.0):
        self.depth_m = depth_m

    def predict(self, rgb, camera):
        return np.full(rgb.shape[:2], self.depth_m, dtype=np.float32)

class Nothing:
    pass

def needs_more():
    import a_package_that_nobody_has
"""


@pytest.fixture
def flat_file(tmp_path: Path) -> Path:
    path = tmp_path / "my_model.py"
    path.write_text(FLAT)
    return path


def test_built_in_models_have_names() -> None:
    assert {"bts", "bts-small", "predictions", "transformers", "zoe", "zoe-small"} <= set(
        model_names()
    )


def test_a_name_takes_an_argument_and_options() -> None:
    model = load_model("bts:small", features=16, max_depth_m=40.0)

    assert isinstance(model, BtsModel)
    assert isinstance(model, DepthModel)
    assert not isinstance(model, StoredDepth)
    assert model.options["encoder"] == "small"
    assert model.max_depth_m == 40.0
    assert not model.is_trained


def test_a_class_in_a_file_is_a_model(
    flat_file: Path, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    model = load_model(f"{flat_file}:Flat", depth_m=7.0)

    depth_m = predict_frame(model, rgb, camera, bridge="B1", frame="000001")

    assert depth_m.shape == (50, 75)
    assert (depth_m == 7.0).all()


@pytest.mark.parametrize(
    ("location", "options", "words", "fix"),
    [
        ("bts-smal", {}, "no such model: 'bts-smal'", "did you mean 'bts-small'"),
        (
            "bts-small",
            {"feature": 3},
            "does not take these options",
            "it takes features, max_depth_m",
        ),
        ("bts-small:x", {}, "does not take these options", "it takes"),
        ("{folder}", {}, "holds no model.pt", "Known: "),
        ("{folder}/my_model.py:Flatt", {}, "no class or function 'Flatt'", "mean 'Flat'"),
        ("{folder}/nowhere.py:Flat", {}, "no such file", "check the path"),
        ("{folder}/my_model.py:Nothing", {}, "no depth model", "predict"),
    ],
)
def test_what_is_no_model_is_told(
    flat_file: Path, location: str, options: dict[str, object], words: str, fix: str
) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        load_model(location.format(folder=flat_file.parent), **options)
    assert fix in caught.value.fix


def test_a_file_that_misses_a_package_says_which(tmp_path: Path) -> None:
    (tmp_path / "m.py").write_text("import a_package_that_nobody_has\n")

    with pytest.raises(MissingExtraError, match="needs a_package_that_nobody_has") as caught:
        load_model(f"{tmp_path / 'm.py'}:M")
    assert caught.value.fix == "pip install a_package_that_nobody_has"


def test_a_run_of_a_model_that_is_not_installed_says_so(tmp_path: Path) -> None:
    import torch

    document = {"civil_rgbd_model": 1, "name": "their-net", "options": {}, "weights": {}}
    torch.save(document, tmp_path / "model.pt")

    with pytest.raises(UsageError, match="'their-net' of this run is not installed"):
        load_model(tmp_path)


@pytest.mark.parametrize(
    "answer", [np.zeros((50, 74)), np.zeros((50, 75, 1)), np.full((50, 75), "far")]
)
def test_an_answer_of_another_shape_is_refused(
    answer: NDArray[np.generic], rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    class Wrong:
        def predict(self, _rgb: object, _camera: object) -> NDArray[np.generic]:
            return answer

    with pytest.raises(FormatError, match=r"to an image of \(50, 75\)") as caught:
        predict_frame(Wrong(), rgb, camera, bridge="B1", frame="000007")  # type: ignore[arg-type] # wrong on purpose
    assert "Wrong, bridge B1, frame 000007" in caught.value.where


def test_stored_predictions_are_asked_by_frame(
    rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    class Stored:
        def depth_of(self, bridge: str, frame: str, camera: PinholeCamera) -> NDArray[np.float32]:
            assert (bridge, frame) == ("B2", "000009")
            return np.ones((camera.height_px, camera.width_px), np.float32)

    assert predict_frame(Stored(), rgb, camera, bridge="B2", frame="000009").all()


def run_without(package: str, code: str) -> str:
    """Run code in a Python where a package cannot be imported."""
    code = f"import sys; sys.modules[{package!r}] = None\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_room_needs_no_torch_until_a_model_does() -> None:
    said = run_without(
        "torch",
        "from civil_rgbd.baselines import load_model, model_names\n"
        "from civil_rgbd.errors import MissingExtraError\n"
        "assert 'bts' in model_names()\n"
        "try:\n    load_model('bts')\nexcept MissingExtraError as error:\n    print(error.fix)",
    )

    assert said.strip() == 'pip install "civil-rgbd[train]"'


@pytest.mark.parametrize("package", ["transformers", "torch"])
def test_zoedepth_without_what_it_needs_names_its_extra(package: str) -> None:
    said = run_without(
        package,
        "from civil_rgbd.baselines import load_model\n"
        "from civil_rgbd.errors import MissingExtraError\n"
        "try:\n    load_model('zoe-small')\n"
        "except MissingExtraError as error:\n    print(error.fix)",
    )

    assert said.strip() == 'pip install "civil-rgbd[zoe]"'


def test_a_file_may_hold_dataclasses_and_lean_on_its_neighbours(
    tmp_path: Path, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    (tmp_path / "helper_beside_it.py").write_text("DEPTH_M = 6.0\n")
    (tmp_path / "deep.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "import numpy as np\n"
        "from helper_beside_it import DEPTH_M\n"
        "@dataclass\n"
        "class Deep:\n"
        "    depth_m: float = DEPTH_M\n"
        "    def predict(self, rgb, camera):\n"
        "        return np.full(rgb.shape[:2], self.depth_m)\n"
    )
    model = load_model(f"{tmp_path / 'deep.py'}:Deep")

    assert (predict_frame(model, rgb, camera, bridge="B1", frame="000001") == 6.0).all()


def test_a_model_that_fails_is_named_with_its_line(
    tmp_path: Path, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    file = tmp_path / "failing.py"
    file.write_text("class Bad:\n    def predict(self, rgb, camera):\n        return 1 / 0\n")
    model = load_model(f"{file}:Bad")

    with pytest.raises(UsageError, match="the model fails: ZeroDivisionError") as caught:
        predict_frame(model, rgb, camera, bridge="B1", frame="000007")
    assert f"{file}:3" in caught.value.fix
    file.write_text("1 / 0\n")
    with pytest.raises(UsageError, match="the model fails: ZeroDivisionError"):
        load_model(f"{file}:Bad")
