"""Attitude, quaternions, the Earth."""
