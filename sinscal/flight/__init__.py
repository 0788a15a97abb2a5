"""Navigation in flight, and what a calibration is worth there."""
