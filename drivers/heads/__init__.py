"""Indexing heads."""
