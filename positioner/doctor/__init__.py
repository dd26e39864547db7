"""`positioner doctor`: problems of machine, bus, state and feedback, with the commands that fix them. Shell."""
