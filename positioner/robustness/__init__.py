"""The robustness test: thousands of dwells of valves, sensors, periods and forces drawn at random, judged by tails."""
