"""The test itself: ramps, moves, readings, resumption."""
