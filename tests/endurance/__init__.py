"""Long runs, for which `make test` has no time. Each starts as `python -m endurance.NAME`."""
