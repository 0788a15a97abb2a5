"""Checks on a running test: its readings, its ramps, its run-in."""
