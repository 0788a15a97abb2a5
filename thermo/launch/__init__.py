"""Start of a test on real or emulated instruments; make-safe."""
