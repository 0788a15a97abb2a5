"""Accelerometers over temperature: sequences, station, store, models, compensation."""
