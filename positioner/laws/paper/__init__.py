"""The paper's controller: estimator, movable bounds, planner. Pure."""
