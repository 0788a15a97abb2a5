"""Instruments: chambers, digitisers and indexing heads, over the bytes they speak."""
