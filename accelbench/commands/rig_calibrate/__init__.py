"""`rig calibrate` and `rig compensate`."""
