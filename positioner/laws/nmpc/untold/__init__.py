"""A lag that nobody has told: found from the moves of a law that believes in none. Pure."""
