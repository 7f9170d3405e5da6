"""A bridge whose truth is known: the default data, the demo, and the tests' double."""

from civil_rgbd.simulator.cache import cached_demo_recording

__all__ = ["cached_demo_recording"]
