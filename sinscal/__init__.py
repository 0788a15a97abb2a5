"""Calibration of strapdown inertial navigation systems on a rig."""
