"""Settings for engines: our own values, in each engine's own words, with the rig filled in."""

from __future__ import annotations

from importlib import resources
from string import Template
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import quaternion_from_matrix
from civil_rgbd.odometry.engines import IMU_TOPIC, LIDAR_TOPIC, Engine

_SETTINGS: Final = "civil_rgbd.odometry.engine_settings"


def settings_text(engine: Engine, T_imu_lidar: NDArray[np.float64]) -> str:
    """Fill in ``engine_settings/<engine>.yaml``.

    Args:
        engine: whose settings.
        T_imu_lidar: (4, 4), LiDAR frame to IMU frame.

    Returns:
        YAML text.
    """
    text = resources.files(_SETTINGS).joinpath(f"{engine.name}.yaml")
    x, y, z, w = quaternion_from_matrix(T_imu_lidar[:3, :3])
    translation = T_imu_lidar[:3, 3]
    return Template(text.read_text("utf-8")).substitute(
        imu_topic=IMU_TOPIC,
        lidar_topic=LIDAR_TOPIC,
        translation_m=_numbers(*translation),
        rotation_rows=_numbers(*T_imu_lidar[:3, :3].ravel()),
        quaternion_wxyz=_numbers(w, x, y, z),
        quaternion_xyzw_and_translation_m=_numbers(x, y, z, w, *translation),
    )


def _numbers(*values: float) -> str:
    # YAML 1.1 takes 1e-05 for text: twelve decimals are a picometre, and never an exponent.
    return ", ".join(f"{value:.12f}" for value in values)
