"""The engine's problem of one accelerometer's chamber runs."""
