"""Poses where a recording has none: odometry engines, run as programs of their own."""
