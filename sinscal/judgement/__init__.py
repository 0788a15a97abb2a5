"""Whether a calibration can be believed, and its result file."""
