"""The bench: a scenario in, its figures and its picture out."""
