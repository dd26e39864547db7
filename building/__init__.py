"""Build of the compiled wheel: expansion of the dataclasses, mypyc, and the hook of hatchling."""
