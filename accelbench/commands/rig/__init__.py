"""The group `rig`."""
