"""A difference of two inputs for PythonFMU3 (FMI 3.0), known at once."""

from pythonfmu3 import Boolean, Float64, Fmi3Causality, Fmi3Slave, Int32


class Difference(Fmi3Slave):
    """The output is ``wanted - found``, or zero while it is off."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.wanted = self.found = 0.0
        self.on, self.count = True, 0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent))
        self.register_variable(Float64("wanted", causality=Fmi3Causality.input))
        self.register_variable(Float64("found", causality=Fmi3Causality.input))
        self.register_variable(Boolean("on", causality=Fmi3Causality.input))
        self.register_variable(Int32("count", causality=Fmi3Causality.input))
        self.register_variable(Float64("error", causality=Fmi3Causality.output, getter=self.error))

    def error(self):
        """Return the difference of the present inputs."""
        return self.wanted - self.found if self.on else 0.0

    def do_step(self, current_time, step_size):
        """Know the time."""
        self.time = current_time + step_size
        return True
