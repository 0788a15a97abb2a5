"""Rig plan."""
