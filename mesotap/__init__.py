"""The application: command line, session runner, report, operator console. Nobody imports it."""

__version__ = "0.1.0"
