"""Rig triad."""
