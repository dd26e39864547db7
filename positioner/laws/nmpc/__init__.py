"""The default law, and everything that only it uses. Pure."""
