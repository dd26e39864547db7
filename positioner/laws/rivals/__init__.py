"""What others have published against stiction, to compare with. Pure."""
