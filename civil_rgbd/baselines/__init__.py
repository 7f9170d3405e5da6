"""Depth models behind one small protocol: BTS, ZoeDepth, and anybody's."""

from civil_rgbd.baselines.model import (
    DepthModel,
    StoredDepth,
    load_model,
    model_names,
    predict_frame,
)

__all__ = [
    "DepthModel",
    "StoredDepth",
    "load_model",
    "model_names",
    "predict_frame",
]
