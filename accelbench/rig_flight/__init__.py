"""Rig flight."""
