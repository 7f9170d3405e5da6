"""Settings of each engine: whole, with the rig filled in, and shipped."""

from __future__ import annotations

import re

import numpy as np
import pytest

from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from
from civil_rgbd.odometry.engines import ENGINES, engine_named
from civil_rgbd.odometry.settings import settings_text

T_IMU_LIDAR = transform_from(matrix_from_quaternion([0.5, 0.5, 0.5, 0.5]), [0.1, -0.2, 1e-7])
"""x of the LiDAR is y of the IMU, y is z, z is x."""


def numbers(text: str, key: str) -> list[float]:
    found = re.search(rf"^\s*{key}: \[(.*)\]", text, re.MULTILINE)
    assert found, key
    return [float(word) for word in found[1].split(",")]


@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_has_settings_and_nothing_is_left_to_fill_in(name: str) -> None:
    text = settings_text(ENGINES[name], T_IMU_LIDAR)

    values = "\n".join(line.partition("#")[0] for line in text.splitlines())
    assert "$" not in values
    assert "e-" not in values  # YAML 1.1 takes 1e-05 for text


def test_the_lidar_sits_where_the_rig_says_in_each_engines_own_words() -> None:
    genz, se3, rko = (settings_text(ENGINES[n], T_IMU_LIDAR) for n in ENGINES)

    assert numbers(genz, "extrinsic_t") == [0.1, -0.2, 1e-7]
    assert np.array_equal(
        np.reshape(numbers(genz, "extrinsic_r"), (3, 3)), [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    )
    assert numbers(se3, "t_exts") == [0.1, -0.2, 1e-7]
    assert numbers(se3, "q_exts") == [0.5, 0.5, 0.5, 0.5]
    assert numbers(rko, "extrinsic_lidar2base_quat_xyzw_xyz") == [0.5] * 4 + [0.1, -0.2, 1e-7]
    assert numbers(rko, "extrinsic_imu2base_quat_xyzw_xyz") == [0, 0, 0, 1, 0, 0, 0]


def test_the_scalar_of_a_quaternion_comes_where_each_engine_wants_it() -> None:
    quarter = transform_from(
        matrix_from_quaternion([0, 0, np.sqrt(0.5), np.sqrt(0.5)]), np.zeros(3)
    )

    se3, rko = (settings_text(ENGINES[name], quarter) for name in ("se3-lio", "rko-lio"))

    assert numbers(se3, "q_exts") == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert numbers(rko, "extrinsic_lidar2base_quat_xyzw_xyz")[:4] == pytest.approx(
        [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    )


def test_a_near_miss_names_the_engine() -> None:
    with pytest.raises(UsageError, match="no odometry engine is called 'genzlio'") as info:
        engine_named("genzlio")

    assert "did you mean 'genz-lio'" in info.value.fix
