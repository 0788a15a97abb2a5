"""Recorded rig runs: read, checked, mended."""
