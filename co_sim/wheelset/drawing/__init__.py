"""The parts of `co_sim.wheelset.figures`: a style, and a module for each kind of figure."""
