"""A second law beside the acting one: what it would do on the same valve, and where the two differ."""
