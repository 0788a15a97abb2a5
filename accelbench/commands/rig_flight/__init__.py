"""`rig flight`."""
