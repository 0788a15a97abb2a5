"""Judgement of a calibration, and its result file."""
