"""The search for missing effects: its state, its steps, their thresholds."""
