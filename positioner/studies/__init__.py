"""Many benches: the league of all laws, the simulations of the paper, the tuning of the rival laws."""
