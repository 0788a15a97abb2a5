"""Search for the effect that an accelerometer's model lacks."""
