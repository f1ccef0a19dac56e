"""The wheelset application of the co-simulation: track, sensors, identifier and scenarios."""
