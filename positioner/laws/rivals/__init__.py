"""Published laws against stiction, for comparison. Pure."""
