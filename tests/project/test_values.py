"""Values are dataclasses: equal, ordered and hashable by their fields, and replaced as the standard library does it."""

from __future__ import annotations

import dataclasses
from dataclasses import KW_ONLY, field

import pytest

from positioner.values import dataclass, replace


@dataclass(frozen=True, slots=True, order=True)
class Stem:
    position_m: float
    names: tuple[str, ...] = field(default_factory=tuple)
    _: KW_ONLY
    stuck: bool = True
    kind: str = field(default="stem", init=False)


@dataclass(slots=True)
class Own:
    count: int


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    gain: float = 1.0


class TestReplace:
    @pytest.mark.parametrize("changes", [{}, {"position_m": 2.0}, {"stuck": False, "names": ("a",)}])
    def test_it_gives_what_the_standard_library_gives(self, changes: dict[str, object]) -> None:
        stem = Stem(1.0, ("x",), stuck=True)
        assert replace(stem, **changes) == dataclasses.replace(stem, **changes)  # type: ignore[arg-type]

    def test_an_unknown_field_is_an_error(self) -> None:
        with pytest.raises(TypeError):
            replace(Stem(1.0), colour="red")  # type: ignore[call-arg]

    def test_it_takes_frozen_dataclasses_as_well(self) -> None:
        assert replace(Settings(), gain=2.0) == Settings(2.0)


class TestValues:
    def test_equal_fields_make_equal_values_with_one_hash(self) -> None:
        assert Stem(1.0) == Stem(1.0) != Stem(1.0, stuck=False)
        assert hash(Stem(1.0)) == hash(Stem(1.0))

    def test_they_are_ordered_by_their_fields(self) -> None:
        assert Stem(1.0) < Stem(2.0)

    def test_a_field_that_is_not_declared_cannot_be_set(self) -> None:
        with pytest.raises(AttributeError):
            Stem(1.0).colour = "red"  # type: ignore[attr-defined]

    def test_a_value_without_slots_cannot_be_declared(self) -> None:
        with pytest.raises(TypeError, match="has slots"):
            dataclass(frozen=True, slots=False)(type("Loose", (), {}))

    def test_one_that_is_not_frozen_is_changed_in_a_copy(self) -> None:
        before = Own(1)
        own = replace(before)
        own.count = 2
        assert (before, own) == (Own(1), Own(2))
        with pytest.raises(TypeError, match="unhashable"):
            hash(own)
