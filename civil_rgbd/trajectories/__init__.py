"""Readers of what lies beside a recording: rig files."""
