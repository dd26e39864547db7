"""Many benches: the league of the laws, the claims of the paper, the tuning of the rivals."""
