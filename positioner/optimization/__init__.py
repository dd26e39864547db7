"""A quadratic programme and the solver that keeps its workspace. Pure, but for the solver."""
