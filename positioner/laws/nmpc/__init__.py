"""The law `nmpc`, and `quasi-static`, which is the same without braked moves. Pure."""
