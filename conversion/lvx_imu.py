"""What the IMU inside a LiDAR wrote into an LVX file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from civil_rgbd.conversion.lvx_file import Device, LvxHeader, frames_of
from civil_rgbd.conversion.lvx_layout import IMU, IMU_BYTES, IMU_LVX2
from civil_rgbd.conversion.lvx_packets import walk_packets
from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.errors import RecordingError


def read_imu(path: Path, header: LvxHeader, device: Device) -> ImuReadings:
    """Read all IMU packets of a device.

    Args:
        path: the file.
        header: of it.
        device: whose IMU.

    Returns:
        its readings; forces in g.

    Raises:
        RecordingError: there are none.
    """
    data = np.memmap(path, dtype=np.uint8, mode="r")
    kind = IMU_LVX2 if header.second else IMU
    stamps, readings = [], []
    for start, end in frames_of(data, header, []):
        packets = walk_packets(data[start:end], second=header.second, devices=header.keys)
        of_imu = (packets.kind == kind) & (packets.device == device.key)
        packets = packets.among(of_imu & (packets.length == IMU_BYTES))
        try:
            stamps.append(packets.stamps_ns())
        except ValueError:
            continue  # the walk over the file told of it; it goes on only under salvage
        places = packets.place[:, np.newaxis] + np.arange(IMU_BYTES)
        readings.append(packets.data[places].reshape(-1, IMU_BYTES).copy().view("<f4"))
    if not sum(map(len, stamps)):
        raise RecordingError(
            "the file holds no IMU readings",
            where=path,
            fix="record the IMU along: in Livox Viewer, or with Livox's ROS driver",
        )
    numbers = np.concatenate(readings).astype(np.float64)
    return ImuReadings(np.concatenate(stamps), numbers[:, :3].copy(), numbers[:, 3:].copy())
