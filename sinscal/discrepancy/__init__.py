"""Search for the effect that the rig filter's model lacks."""
