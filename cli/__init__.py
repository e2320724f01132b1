"""The command line: `start.py` begins, `main.py` holds the table of commands, one file each.

A command is a module with two functions: `add_options(parser)`, and `run(options)`, which returns
the lines to print and raises `SPMMError` for bad input. The docstring of the module is what its
help begins with. Modules that need torch are imported inside of functions, so that every `--help`
is quick.
"""
