"""Effects that a calibration's model lacks: what each would do."""
