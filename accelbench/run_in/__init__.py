"""Run in."""
