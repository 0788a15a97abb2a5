"""Noise: its model, whitening, Allan variance."""
