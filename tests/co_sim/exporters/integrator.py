"""An integrator for PythonFMU (FMI 2.0), with a port of every type."""

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class Integrator(Fmi2Slave):
    """The output is the gain times the integral of the input, which is held during a step."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.gain, self.u, self.y = 1.0, 0.0, 0.0
        self.steps, self.high, self.words = 0, False, "none"
        self.register_variable(
            Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Integer("steps", causality=Fmi2Causality.output))
        self.register_variable(Boolean("high", causality=Fmi2Causality.output))
        self.register_variable(String("words", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        """Advance, and fail where the input is beyond all bounds."""
        if abs(self.u) > 1e3:
            self.log(f"an input of {self.u:g} is too much")
            return False
        self.y += self.gain * self.u * step_size
        self.steps += 1
        self.high = self.y > 0.5
        self.words = f"Größe {self.steps}"
        return True
