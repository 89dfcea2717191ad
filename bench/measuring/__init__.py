"""The parts of svbench: command.py knows the subcommands, common.py what they share."""
