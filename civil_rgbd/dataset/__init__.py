"""PyTorch datasets of bridge folders; needs the extra ``torch``."""

from civil_rgbd.errors import MissingExtraError

try:
    import torch as _torch  # noqa: F401 - asked for here, once, so that the answer is in words
except ImportError as error:
    raise MissingExtraError(
        f"the PyTorch datasets need torch, and it cannot be imported: {error}",
        where="civil_rgbd.dataset",
        fix='pip install "civil-rgbd[torch]"',
    ) from error

from civil_rgbd.dataset.bridge_dataset import BridgeDataset, BridgeSequenceDataset

__all__ = ["BridgeDataset", "BridgeSequenceDataset"]
