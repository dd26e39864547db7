"""The first lines of the emulator's program. Shell."""

import sys

from positioner.start import load


def main() -> int:
    """Load and run the emulator; return its exit status."""
    return load("plant-emulator", "plant_emulator.cli.main")


if __name__ == "__main__":
    sys.exit(main())
