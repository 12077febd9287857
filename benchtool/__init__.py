"""Drive rotor test benches near surfaces and fit ground-effect models to what they measure."""

__version__ = "0.1.0"
