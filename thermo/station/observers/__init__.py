"""Observers of a running test: in a thread of their own, and the live estimate."""
