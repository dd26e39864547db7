"""Control laws: one interface, one file or folder for each law, one registry. Pure."""
