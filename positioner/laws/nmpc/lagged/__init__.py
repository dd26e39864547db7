"""The law `nmpc` on a valve whose pressure follows the current with a lag: one file for each part. Pure."""
