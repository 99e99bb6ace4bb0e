"""Numbers that may differ between seeds: found by their marks, changed by name, and merged into one setting."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import pytest
import torch
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods import all_methods
from rled_agent.nn.architecture import Architecture
from rled_agent.per_seed import PER_SEED, changed, column, merged, numbers, of_seed
from rled_msgs_py.errors import ContractError
from rled_msgs_py.validation import Range, check_fields


@dataclass(frozen=True)
class Inner:
    rate: Annotated[float, Range(0, 1), PER_SEED] = 0.5
    count: Annotated[int, Range(0, 9)] = 3

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Outer:
    phi: Annotated[float, Range(0, 1), PER_SEED] = 0.1
    name: str = "one"
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        check_fields(self)


def test_numbers_are_the_marked_fields_with_dots_before_those_within():
    assert numbers(Outer()) == ["phi", "inner.rate"]
    assert numbers(Outer(), "method.") == ["method.phi", "method.inner.rate"]


def test_a_number_is_changed_where_it_is_and_nothing_else():
    begin = Outer()
    assert changed(begin, "phi", 0.3) == Outer(0.3)
    assert changed(begin, "inner.rate", 0.3) == Outer(inner=Inner(0.3))
    assert begin == Outer()


@pytest.mark.parametrize("name", ["name", "inner", "inner.count", "inner.rate.more", "rate", "", "phi.", "x" * 500])
def test_what_is_no_number_cannot_be_swept(name):
    with pytest.raises(ContractError, match=r"no number '.{0,80}' to sweep; accepted: phi, inner.rate"):
        changed(Outer(), name, 0.5)


@pytest.mark.parametrize("name", ["phi", "inner.rate"])
def test_numbers_out_of_their_range_are_refused(name):
    with pytest.raises(ContractError, match=r"is 1\.5; accepted: 0 to 1"):
        changed(Outer(), name, 1.5)


def test_settings_that_do_not_differ_are_merged_into_themselves():
    first = Outer(0.3)
    assert merged([first]) is first
    assert merged([first, Outer(0.3), Outer(0.3)]) is first


def test_only_numbers_that_differ_become_tensors_of_each_seed():
    whole = merged([Outer(0.1), Outer(0.3), Outer(0.1)])
    assert isinstance(whole, Outer)
    assert whole.phi.tolist() == [0.1, 0.3, 0.1]  # in double precision, as they were given
    assert (whole.name, whole.inner) == ("one", Inner())
    within = merged([Outer(inner=Inner(0.2)), Outer(inner=Inner(0.4))])
    assert within.inner.rate.tolist() == [0.2, 0.4]
    assert (within.phi, within.inner.count) == (0.1, 3)


@pytest.mark.parametrize("other", [Outer(name="two"), Outer(0.4, name="two"), Outer(inner=Inner(0.2, 4))])
def test_nothing_but_numbers_may_differ(other):
    with pytest.raises(ContractError, match=r"(name|count) differs between seeds; accepted: one value for all of them"):
        merged([Outer(), other])


def test_each_seed_gets_its_number_back():
    values = (0.1, 1 / 3, 1e-3)
    whole = merged([Outer(each) for each in values])
    assert [of_seed(whole.phi, k) for k in range(3)] == list(values)
    assert [of_seed(0.7, k) for k in range(3)] == [0.7] * 3


def test_a_column_stands_beside_what_it_is_combined_with():
    whole = merged([Outer(0.1), Outer(0.3)])
    for dimensions in (1, 2, 3):
        for kind in (torch.float32, torch.float64):
            each = column(whole.phi, torch.zeros(2, *[5] * (dimensions - 1), dtype=kind))
            assert each.shape == (2, *[1] * (dimensions - 1))
            assert each.dtype == kind
    assert column(0.1, torch.zeros(2)) == 0.1


@pytest.mark.parametrize("value", [0.1, 1 / 3, 0.99, 1e-3, 0.7])
def test_a_column_changes_a_tensor_as_a_single_number_does_bit_for_bit(value):
    rows = torch.randn(2, 1001, 1, generator=torch.Generator().manual_seed(0))
    each = column(merged([Outer(value), Outer(0.25)]).phi, rows)
    assert (rows * each).dtype == torch.float32
    assert torch.equal((rows * each)[0], rows[0] * value)
    assert torch.equal((rows < each)[0], rows[0] < value)
    assert torch.equal(rows.clamp(-each, each)[0], rows[0].clamp(-value, value))


def test_structures_of_networks_are_for_all_seeds():
    config = TD3Config()
    wider = replace(config, actor=Architecture(hidden=(7,)))
    assert not [name for name in numbers(config) if name.startswith(("actor.", "critic."))]
    with pytest.raises(ContractError, match="hidden differs between seeds"):
        merged([config, wider])


@pytest.mark.parametrize("name", all_methods())
def test_every_number_of_every_method_can_be_swept(name):
    method = all_methods()[name]()
    for number in numbers(method):
        first, second = changed(method, number, 0.25), changed(method, number, 0.5)
        value = merged([first, second])
        for part in number.split("."):
            value = getattr(value, part)
        assert value.tolist() == [0.25, 0.5]
