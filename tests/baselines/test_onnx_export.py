"""ONNX: the same answers without torch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.baselines import onnx_export
from civil_rgbd.baselines.model import load_model
from civil_rgbd.baselines.onnx_export import export_onnx
from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.errors import FormatError, OutputError
from civil_rgbd.geometry.camera import PinholeCamera

onnxruntime = pytest.importorskip("onnxruntime", reason="comes with the extra onnx")


def small(name: str, **options: object) -> TorchDepthModel:
    model = load_model(name, **options)
    assert isinstance(model, TorchDepthModel)
    return model


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("bts-small", {"features": 16, "focal_reference_px": 100.0, "rest": "crop"}),
        ("bts-small", {"features": 16, "width_px": 64, "height_px": 32}),
        ("zoe-small", {}),
    ],
    ids=["bts", "bts resized", "zoe"],
)
def test_onnxruntime_answers_as_the_model_predicts(
    name: str,
    options: dict[str, object],
    tmp_path: Path,
    rgb: NDArray[np.uint8],
    camera: PinholeCamera,
) -> None:
    model = small(name, **options).train()
    path = tmp_path / "model.onnx"

    done = export_onnx(model, path, height_px=50, width_px=75)

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    given = {
        "rgb": rgb.transpose(2, 0, 1)[None].astype(np.float32) / 255,
        "intrinsics": camera.matrix[None].astype(np.float32),
    }
    names = [one.name for one in session.get_inputs()]
    (answer,) = session.run(["depth_m"], {name: given[name] for name in names})
    np.testing.assert_allclose(answer[0, 0], model.predict(rgb, camera), rtol=1e-4)
    assert done.usual_difference <= done.largest_difference < 1e-3
    assert done.bytes == path.stat().st_size
    assert model.training
    assert [one.name for one in tmp_path.iterdir()] == ["model.onnx"]


@pytest.mark.slow
def test_a_file_that_answers_otherwise_never_appears(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = onnx_export._run
    monkeypatch.setattr(onnx_export, "_run", lambda *given: right(*given) * np.float32(1.002))

    with pytest.raises(FormatError, match=r"differ by 0\.20% of the depth"):
        export_onnx(small("bts-small", features=16), tmp_path / "m.onnx", height_px=32, width_px=32)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write: No such file"):
        export_onnx(
            small("bts-small", features=16),
            tmp_path / "nowhere" / "m.onnx",
            height_px=32,
            width_px=32,
        )
