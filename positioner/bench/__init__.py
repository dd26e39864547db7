"""The bench: it plays a scenario in a closed loop, and computes figures and a picture."""
