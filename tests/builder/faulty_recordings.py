"""Recordings with a fault at image 20; workers of any kind import them by name."""

from __future__ import annotations

import os
import signal

from civil_rgbd.domain.recording import CameraImage
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec


class _Faulty(SimulatedRecording):
    """Stays what it is on its way to another process."""

    def __reduce__(self) -> tuple[type[SimulatedRecording], tuple[ScanSpec]]:
        return type(self), (self.spec,)


class RaisesAtImage20(_Faulty):
    """A converter with a fault of its own."""

    def read_image(self, index: int) -> CameraImage:
        """Read an image, but for one."""
        if index == 20:
            raise ZeroDivisionError("division by zero")
        return super().read_image(index)


class DiesAtImage20(_Faulty):
    """Reading its image 20 kills the process, as the kernel does when memory runs out."""

    def read_image(self, index: int) -> CameraImage:
        """Read an image, but for one."""
        if index == 20:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().read_image(index)
