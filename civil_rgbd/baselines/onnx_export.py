"""A trained model as ONNX: one file that runs without torch, compared with torch before it counts.

The file takes plain images of one size and gives metres: resizing, padding and normalisation are
inside. ``rgb`` (1, 3, H, W) float32 in 0 to 1, red first, and ``intrinsics`` (1, 3, 3) float32 in
pixels go in; ``depth_m`` (1, 1, H, W) float32 comes out.
"""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from civil_rgbd.baselines.fitting import apply_fit, plan_fit, undo_fit
from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.errors import FormatError, MissingExtraError
from civil_rgbd.storage.whole_files import whole_file

OPSET: Final = 18
"""The first whose Resize knows antialiasing."""

TOLERANCE: Final = 1e-3
"""By how much the two answers may differ, as a share of depth, in 99 of 100 pixels.

BTS divides by what may be nearly zero, so single pixels may differ more.
"""


@dataclass(frozen=True, slots=True)
class OnnxExport:
    """What came out.

    Attributes:
        path: the file.
        bytes: its size.
        usual_difference: between onnxruntime and torch, as a share of depth; 99 of 100 pixels
            differ less.
        largest_difference: the same for the worst pixel.
    """

    path: Path
    bytes: int
    usual_difference: float
    largest_difference: float


class _AnySize(nn.Module):
    """A model with the fit to one image size around it."""

    def __init__(self, model: TorchDepthModel, *, height_px: int, width_px: int) -> None:
        super().__init__()
        self.model = model
        self.plan = plan_fit(model.fit, height_px=height_px, width_px=width_px)

    def forward(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        fitted, K = apply_fit(self.plan, rgb, intrinsics)
        return undo_fit(self.plan, self.model(fitted, K))


def export_onnx(
    model: TorchDepthModel, path: Path, *, height_px: int, width_px: int, seed: int = 0
) -> OnnxExport:
    """Write a model as ONNX, and compare it with torch on a random image.

    Args:
        model: any trainable model, on the CPU.
        path: the file to make; it appears when it is whole and agrees with torch.
        height_px: rows of the images it will be given.
        width_px: columns of them.
        seed: of the image.

    Raises:
        MissingExtraError: onnx, onnxscript or onnxruntime is not installed.
        FormatError: the network cannot be written as ONNX, or answers otherwise there.
        OutputError: the file cannot be written.
    """
    _require_onnx(path)
    generator = np.random.default_rng(seed)
    rgb = generator.random((1, 3, height_px, width_px), dtype=np.float32)
    focal, cx, cy = 0.5 * width_px, (width_px - 1) / 2, (height_px - 1) / 2
    K = np.array([[[focal, 0, cx], [0, focal, cy], [0, 0, 1]]], dtype=np.float32)
    was_training = model.training
    whole = _AnySize(model.eval(), height_px=height_px, width_px=width_px)
    try:
        with whole_file(path) as scratch:
            with torch.no_grad():
                expected = whole(torch.from_numpy(rgb), torch.from_numpy(K)).numpy()
                _write(whole, (torch.from_numpy(rgb), torch.from_numpy(K)), scratch, where=path)
            usual, largest = _compare(expected, _run(scratch, rgb, K), where=path)
    finally:
        model.train(was_training)
    return OnnxExport(path, path.stat().st_size, usual, largest)


def _require_onnx(path: Path) -> None:
    try:
        import onnx  # noqa: F401  # only whether they are there
        import onnxruntime  # noqa: F401
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            f"writing ONNX needs {error.name}", where=path, fix='pip install "civil-rgbd[onnx]"'
        ) from error


def _write(
    whole: nn.Module, arguments: tuple[Tensor, Tensor], scratch: Path, *, where: Path
) -> None:
    scratch.touch()  # a folder that takes no file gets the system's own words
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        # The exporter prints and warns of its own internals, which nobody here can mend.
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            torch.onnx.export(
                whole,
                arguments,
                str(scratch),
                input_names=["rgb", "intrinsics"],
                output_names=["depth_m"],
                opset_version=OPSET,
                dynamo=True,
                external_data=False,
                verbose=False,
            )
    except (torch.onnx.errors.OnnxExporterError, RuntimeError) as error:
        raise FormatError(
            f"this network cannot be written as ONNX: {str(error).splitlines()[0][:300]}",
            where=where,
            fix="try another version of torch and onnxscript",
        ) from error
    finally:
        logger.setLevel(level)


def _run(
    path: Path, rgb: NDArray[np.float32], intrinsics: NDArray[np.float32]
) -> NDArray[np.float32]:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    # The exporter leaves out an input that a network does not use.
    given = {"rgb": rgb, "intrinsics": intrinsics}
    used = {one.name: given[one.name] for one in session.get_inputs()}
    answer: NDArray[np.float32] = session.run(["depth_m"], used)[0]
    return answer


def _compare(
    expected: NDArray[np.float32], found: NDArray[np.float32], *, where: Path
) -> tuple[float, float]:
    answered = np.isfinite(expected)
    same = found.shape == expected.shape and bool(np.array_equal(answered, np.isfinite(found)))
    if not same or not answered.any():
        raise FormatError(
            f"onnxruntime answers {found.shape} with {int(np.isfinite(found).sum())} depths, torch "
            f"{expected.shape} with {int(answered.sum())}",
            where=where,
            fix="try another version of torch and onnxscript",
        )
    difference = np.abs(found[answered] / expected[answered] - 1.0)
    usual, largest = float(np.quantile(difference, 0.99)), float(difference.max())
    if usual > TOLERANCE:
        raise FormatError(
            f"onnxruntime and torch differ by {usual:.2%} of the depth and more",
            where=where,
            fix="try another version of torch and onnxscript",
        )
    return usual, largest
