"""Long runs: what `make test` has no time for. Each starts as `python -m endurance.NAME`."""
