"""Calibration of a triad from rests."""
