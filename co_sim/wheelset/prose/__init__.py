"""The parts of `co_sim.wheelset.report` that turn numbers into sentences."""
