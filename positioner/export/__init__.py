"""The signals of a recorded bus in a file that other programs open: CSV, Parquet, MDF 4."""
