"""Recorded runs: read, checked, written; other people's logs."""
