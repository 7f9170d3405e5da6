"""The slow, obvious twin of the metrics: numpy as in the papers, one image at a time."""

from __future__ import annotations

import numpy as np


def valid_pairs(
    prediction: np.ndarray, truth: np.ndarray, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Predictions and truths of the pixels that count, predictions clamped."""
    p = np.asarray(prediction, dtype=np.float64).ravel()
    g = np.asarray(truth, dtype=np.float64).ravel()
    valid = (g > low) & (g < high)
    p = np.where(np.isnan(p), low, p)
    return np.clip(p, low, high)[valid], g[valid]


def errors(p: np.ndarray, g: np.ndarray) -> dict[str, float]:
    """All metrics of pixels."""
    d = np.log(p) - np.log(g)
    worse = np.maximum(p / g, g / p)
    return {
        "abs_rel": float(np.mean(np.abs(p - g) / g)),
        "sq_rel": float(np.mean((p - g) ** 2 / g)),
        "rmse": float(np.sqrt(np.mean((p - g) ** 2))),
        "rmse_log": float(np.sqrt(np.mean(d**2))),
        "log10": float(np.mean(np.abs(np.log10(p) - np.log10(g)))),
        "silog": float(100 * np.sqrt(np.mean(d**2) - np.mean(d) ** 2)),
        "delta_1": float(np.mean(worse < 1.25)),
        "delta_2": float(np.mean(worse < 1.25**2)),
        "delta_3": float(np.mean(worse < 1.25**3)),
    }
