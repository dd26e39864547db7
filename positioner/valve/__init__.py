"""What is believed of a valve: its parameters, its motion, its stiction table and what is credible of it. Pure."""
