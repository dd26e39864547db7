"""A parser of command lines that answers a name that it does not know with the nearest one that it does. Shell."""

from __future__ import annotations

import argparse

from positioner.inputs.nearest import nearest


class Parser(argparse.ArgumentParser):
    """Like its base, also for the parsers of its sub-commands; a typo is a wrong command line, status 2."""

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse a `value` that is none of the action's choices.

        Raises:
            ArgumentError: it is none.
        """
        if action.choices is not None and value not in action.choices:
            told = f"{value!r} is unknown; {nearest(str(value), map(str, action.choices))}"
            raise argparse.ArgumentError(action, told)
