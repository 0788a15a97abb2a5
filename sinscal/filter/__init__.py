"""Kalman filter of a rig run."""
