"""The commands as functions, results that show themselves in a notebook, and a plugin for pytest."""
