"""The parts of svbench."""
