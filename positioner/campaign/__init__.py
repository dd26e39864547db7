"""Studies over the parameters of plant, sensor, actuator and laws: their designs, runs, results and pictures."""
