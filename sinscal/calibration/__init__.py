"""Calibration by the filter, with its consistency."""
