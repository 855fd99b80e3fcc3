"""What studies share: the command, results, tables, timing, machine, plots, and flames."""
