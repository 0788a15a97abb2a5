"""Rig and chamber in one filter."""
