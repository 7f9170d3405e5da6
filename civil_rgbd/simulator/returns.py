"""Which laser pulses come back, and how well their ranges are known.

A surface throws back signal in proportion to its reflectivity and to the cosine of the angle at
which the beam meets it, and inversely to the square of its range. Weak signals get lost, those that
are just strong enough are noisier, and so are beams that slant: their footprint spans many ranges.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DIFFUSE_WHITE: Final = 150.0
"""Livox's reflectivity of a surface that scatters all light: Livox Avia user manual."""

REFERENCE_RANGE_M: Final = 20.0
"""Range at which data sheets state the noise, 2 cm for the Avia."""
_REFERENCE_SHARE: Final = 0.4  # concrete
_SIGNAL_SHARE: Final = 0.05  # of the variance there that goes with the signal; an assumption
_FOOTPRINT_RAD: Final = math.radians(0.28) / math.sqrt(12)  # 1 sigma over the Avia's beam
_CENTROID_SHARE: Final = 0.25  # of the footprint's spread that shows as noise; an assumption
_WEAKEST: Final = 400.0  # hardly any pulse returns that is weaker still
_STEEPEST: Final = 10.0  # tangent beyond which so slanting a beam hardly ever returns


def signal(reflectivity: Floats, range_m: Floats, cosine: Floats) -> Floats:
    """Return the strength of the echoes: 1 = a white surface that faces the sensor 1 m away.

    Args:
        reflectivity: (N,) as Livox reports it, 0 to 255.
        range_m: (N,) above 0.
        cosine: (N,) of the angle between beam and normal, 1 = head on.

    >>> signal(np.array([15.0]), np.array([10.0]), np.array([1.0])).tolist()
    [0.001]
    """
    return reflectivity / DIFFUSE_WHITE * cosine / (range_m * range_m)


def return_probability(strength: Floats, *, range_at_10_percent_m: float) -> Floats:
    """Return the share (N,) of pulses that come back.

    Args:
        strength: (N,) as :func:`signal` gives it.
        range_at_10_percent_m: where half of the pulses return from a 10 % surface, head on.

    >>> facing, tenth = np.ones(3), np.full(3, 15.0)
    >>> at = signal(tenth, np.array([95.0, 190.0, 380.0]), facing)
    >>> return_probability(at, range_at_10_percent_m=190.0).round(3).tolist()
    [0.996, 0.5, 0.004]
    """
    # Spelt as products: the exponential of a logistic curve differs between processors.
    half = strength / (0.1 / (range_at_10_percent_m * range_at_10_percent_m))
    fourth = half * half * half * half
    return fourth / (1 + fourth)


def range_sigma_m(strength: Floats, range_m: Floats, cosine: Floats, *, at_20_m: float) -> Floats:
    """Return the standard deviation (N,) of ranges, metres.

    Args:
        strength: (N,) as :func:`signal` gives it.
        range_m: (N,).
        cosine: (N,) of the angle between beam and normal.
        at_20_m: the deviation on concrete that faces the sensor 20 m away.

    >>> white = range_sigma_m(np.array([0.001]), np.array([20.0]), np.ones(1), at_20_m=0.02)
    >>> white.round(4).tolist()
    [0.02]
    """
    reference = _REFERENCE_SHARE / REFERENCE_RANGE_M**2
    weak = np.minimum(reference / np.maximum(strength, 1e-12), _WEAKEST)
    tangent = np.sqrt(np.maximum(1 - cosine * cosine, 0.0)) / np.maximum(cosine, 1e-6)
    spread = _CENTROID_SHARE * _FOOTPRINT_RAD * range_m * np.minimum(tangent, _STEEPEST)
    head_on = at_20_m * at_20_m * (1 - _SIGNAL_SHARE + _SIGNAL_SHARE * weak)
    sigma: Floats = np.sqrt(head_on + spread * spread)
    return sigma
