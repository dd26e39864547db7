"""The reference of the Python API has every name that the package promises, by the place where it is documented."""

from __future__ import annotations

import re
from importlib import import_module

import positioner
from documents.api import page


def test_every_promised_name_is_on_the_page_and_has_a_docstring() -> None:
    places = re.findall(r"^::: (\S+)$", page(), re.MULTILINE)
    assert sorted(place.rpartition(".")[2] for place in places) == sorted(positioner.__all__)
    for place in places:
        module, _, name = place.rpartition(".")
        found = getattr(import_module(module), name)
        assert found.__doc__, place
        assert found is getattr(positioner, name)
