"""The parts of svpaper."""
