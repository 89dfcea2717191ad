"""The parts of `svbench paper`."""
