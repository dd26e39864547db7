"""What a valve can reach with its currents, sensor, lag and period: computed from the model, before it moves."""
