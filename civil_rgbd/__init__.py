"""LiDAR RGB-D data of civil structures: format, recipes, loaders.

The front door is short and costs nothing: what needs torch or numba is imported when asked for.
"""

from typing import TYPE_CHECKING

from civil_rgbd.errors import CivilRgbdError

if TYPE_CHECKING:
    from civil_rgbd.converters import open_recording
    from civil_rgbd.dataset import BridgeDataset, BridgeSequenceDataset

__version__ = "0.1.0"

__all__ = [
    "BridgeDataset",
    "BridgeSequenceDataset",
    "CivilRgbdError",
    "__version__",
    "open_recording",
]

_LAZY = {
    "BridgeDataset": "civil_rgbd.dataset",
    "BridgeSequenceDataset": "civil_rgbd.dataset",
    "open_recording": "civil_rgbd.converters",
}


def __getattr__(name: str) -> object:
    # BridgeDataset needs torch; building and validating must not pay for it.
    if name in _LAZY:
        from importlib import import_module

        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
