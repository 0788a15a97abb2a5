"""Observers of a running test: observers in separate threads, and the live estimate."""
