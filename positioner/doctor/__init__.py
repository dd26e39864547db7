"""`positioner doctor`: what of the machine, the bus and the state directory stands in a positioner's way. Shell."""
