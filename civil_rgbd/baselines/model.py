"""What a depth model is, and the one way to get one. Nothing here needs torch."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import TYPE_CHECKING, Final, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import CivilRgbdError, FormatError, MissingExtraError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.resources import nearest

if TYPE_CHECKING:
    from civil_rgbd.baselines.torch_model import TorchDepthModel

ENTRY_POINT_GROUP: Final = "civil_rgbd.models"
"""A model is a callable under this group that returns a :class:`DepthModel`.

A class will do. ``load_model("name")`` calls it without arguments, ``load_model("name:what")`` with
``"what"``, and keyword options are handed on.
"""

_FILE_MODULES: Final = "civil_rgbd_model_file_"
"""Begins the name of the module that a user's file becomes."""

_OURS: Final = "civil_rgbd."

_ZOE: Final = ("zoe", "zoe-small")
"""Models that stand on transformers, as ``transformers`` does."""

MODEL_FILE: Final = "model.pt"
"""The file in a run folder that holds a trained model: its name, its options, its weights."""


@runtime_checkable
class DepthModel(Protocol):
    """Anything that sees depth in an image. This one method is all that scoring asks for.

    What can also be trained is a :class:`civil_rgbd.baselines.torch_model.TorchDepthModel`.
    """

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        """Predict the depth of every pixel.

        Args:
            rgb: (H, W, 3) uint8, red first.
            camera: the pinhole of that image, W x H pixels.

        Returns:
            (H, W) float32, metres along the optical axis; NaN where the model has no answer.
        """
        ...


@runtime_checkable
class StoredDepth(Protocol):
    """Predictions that were made elsewhere: they go by frame, not by image."""

    def depth_of(self, bridge: str, frame: str, camera: PinholeCamera) -> NDArray[np.float32]:
        """Give the stored prediction of a frame.

        Args:
            bridge: id of the bridge.
            frame: id of the frame.
            camera: the pinhole of the frame's image, W x H pixels.

        Returns:
            (H, W) float32, metres along the optical axis; NaN where there is no answer.
        """
        ...


ModelFactory = Callable[..., DepthModel | StoredDepth]


def model_names() -> list[str]:
    """Return the names of all installed models, built in and others'."""
    return sorted(_factories())


def load_model(location: str | Path, **options: object) -> DepthModel | StoredDepth:
    """Give a model by name, from a run folder, or from a Python file.

    Args:
        location: a run folder or its ``model.pt``; an installed name such as ``bts-small``, or
            ``name:what`` for one that takes an argument (``predictions:FOLDER``,
            ``transformers:MODEL``); or ``FILE.py:NAME`` for a class or function of your own.
        options: handed to the model, such as ``max_depth_m=40.0``; those of a run folder are known
            from training and are replaced one by one.

    Returns:
        a model, on the CPU and ready to predict. A name gives untrained weights, except where its
        weights come from a hub or folder.

    Raises:
        UsageError: there is no such model, or it does not take these options.
        FormatError: the file holds no model, or its weights do not fit.
        MissingExtraError: the model needs a package that is not installed.
    """
    text = str(location)
    known = _factories()
    name, colon, argument = text.partition(":")
    if name in known:
        return _made(_loaded(known[name]), text, [argument] if colon else [], options)
    file, colon, attribute = text.rpartition(":")
    if colon and file.endswith(".py"):
        return _made(_attribute_of(Path(file), attribute), text, [], options)
    return _from_run(Path(location), known, options)


def predict_frame(
    model: DepthModel | StoredDepth,
    rgb: NDArray[np.uint8],
    camera: PinholeCamera,
    *,
    bridge: str,
    frame: str,
) -> NDArray[np.float32]:
    """Predict a frame with a model of either kind, and hold it to its word.

    Args:
        model: sees the image, or knows the frame.
        rgb: (H, W, 3) uint8, red first.
        camera: the pinhole of that image, W x H pixels.
        bridge: id of the bridge.
        frame: id of the frame.

    Returns:
        (H, W) float32, metres along the optical axis; NaN where there is no answer.

    Raises:
        FormatError: the answer has another shape, or is no number.
        UsageError: a model that is not ours fails.
    """
    where = f"{type(model).__name__}, bridge {bridge}, frame {frame}"
    try:
        if isinstance(model, DepthModel):
            depth_m = np.asarray(model.predict(rgb, camera))
        else:
            depth_m = np.asarray(model.depth_of(bridge, frame, camera))
    except Exception as error:
        if isinstance(error, CivilRgbdError) or type(model).__module__.startswith(_OURS):
            raise
        raise _fault_of_model(error, where=where) from error
    if depth_m.shape != rgb.shape[:2] or depth_m.dtype.kind not in "fiu":
        raise FormatError(
            f"the model answers {depth_m.dtype} {depth_m.shape} to an image of {rgb.shape[:2]}",
            where=where,
            fix="return (H, W) metres of the image's own size, as numbers",
        )
    return depth_m.astype(np.float32, copy=False)


def _fault_of_model(error: Exception, *, where: str) -> UsageError:
    place = extract_tb(error.__traceback__)[-1]
    return UsageError(
        f"the model fails: {type(error).__name__}: {error}",
        where=where,
        fix=f"mend the model; it was at {place.filename}:{place.lineno}",
    )


def _factories() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


def _loaded(point: EntryPoint) -> ModelFactory:
    try:
        return cast("ModelFactory", point.load())
    except ModuleNotFoundError as error:
        raise _missing(error, where=f"model {point.name}", model=point.name) from error


def _missing(error: ModuleNotFoundError, *, where: object, model: str = "") -> MissingExtraError:
    # Named at once, and not only when torch is there: nobody installs twice for one model.
    extra = "zoe" if "transformers" in {error.name, model} or model in _ZOE else "train"
    ours = error.name in {"torch", "transformers"}
    return MissingExtraError(
        f"the model needs {error.name}, which is not installed",
        where=where,
        fix=f'pip install "civil-rgbd[{extra}]"' if ours else f"pip install {error.name}",
    )


def _made(
    factory: ModelFactory, where: str, arguments: list[str], options: Mapping[str, object]
) -> DepthModel | StoredDepth:
    try:
        inspect.signature(factory).bind(*arguments, **options)
    except TypeError as error:
        raise UsageError(
            f"the model does not take these options: {error}",
            where=where,
            fix="it takes " + (", ".join(inspect.signature(factory).parameters) or "none"),
        ) from error
    model = factory(*arguments, **options)
    if not isinstance(model, (DepthModel, StoredDepth)):
        raise UsageError(
            f"a {type(model).__name__} is no depth model: it has no method predict",
            where=where,
            fix="give it predict(rgb, camera) -> (H, W) metres; see docs/tutorials",
        )
    return model


def _attribute_of(file: Path, attribute: str) -> ModelFactory:
    from importlib.util import module_from_spec, spec_from_file_location

    if not file.is_file():
        raise UsageError("there is no such file", where=file, fix="check the path")
    # A name of its own: a file called numpy.py must not stand in for the package.
    spec = spec_from_file_location(f"{_FILE_MODULES}{file.stem}", file)
    if spec is None or spec.loader is None:
        raise UsageError("the file is no Python module", where=file, fix="give a .py file")
    module = module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses and pickle look for it there
    folder = str(file.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # it may import what lies beside it, now or when it predicts
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        raise _missing(error, where=file) from error
    except Exception as error:
        raise _fault_of_model(error, where=str(file)) from error
    if not callable(getattr(module, attribute, None)):
        raise UsageError(
            f"the file defines no class or function {attribute!r}",
            where=file,
            fix=nearest(attribute, _own_names(module)),
        )
    return cast("ModelFactory", getattr(module, attribute))


def _own_names(module: ModuleType) -> list[str]:
    return [
        name
        for name, value in vars(module).items()
        if callable(value) and getattr(value, "__module__", None) == module.__name__
    ]


def _from_run(
    path: Path, known: Mapping[str, EntryPoint], options: Mapping[str, object]
) -> DepthModel | StoredDepth:
    file = path / MODEL_FILE if path.is_dir() else path
    if not file.is_file():
        kind = f"the folder holds no {MODEL_FILE}" if path.is_dir() else "there is no such model"
        raise UsageError(f"{kind}: {str(path)!r}", where=path, fix=nearest(path.name, known))
    try:
        from civil_rgbd.baselines.checkpoints import load_into, read_model_file
    except ModuleNotFoundError as error:
        raise _missing(error, where=file) from error
    saved = read_model_file(file)
    if saved.name not in known:
        raise UsageError(
            f"the model {saved.name!r} of this run is not installed",
            where=file,
            fix=f"install the package that brings it. {nearest(saved.name, known)}",
        )
    model = _made(_loaded(known[saved.name]), str(file), [], {**saved.options, **options})
    load_into(cast("TorchDepthModel", model), saved.weights, where=file)
    return model
