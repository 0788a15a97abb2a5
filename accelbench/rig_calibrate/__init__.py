"""Rig calibrate."""
