"""`rig triad`."""
