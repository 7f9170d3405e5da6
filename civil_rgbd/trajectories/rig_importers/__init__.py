"""Calibrations as other people's programs write them, read into rig files."""
