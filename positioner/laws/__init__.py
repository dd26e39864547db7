"""Control laws: one interface, one file a law, one registry. Pure."""
