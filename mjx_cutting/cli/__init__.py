"""The command line: one thin command a verb, each in the file of its kind; importing it loads no room."""

from mjx_cutting.cli.app import main

__all__ = ["main"]
