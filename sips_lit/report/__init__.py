"""The report of a benchmark: page, figures, tables and numbers, all from its records."""
