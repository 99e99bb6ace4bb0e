"""Random numbers of a population: against SplitMix64 in Python, and each seed's as if it were alone."""

import math

import numpy as np
import pytest
import torch
from rled_agent.nn.draws import AHEAD, GOLDEN, Draws, _mixed_on_device, _signed

WORD = 2**64
SEEDS = (0, 1, 7, 2**40)
PUBLISHED = (
    6457827717110365317,
    3203168211198807973,
    9817491932198370423,
    4593380528125082431,
    16408922859458223821,
)
"""The first numbers of SplitMix64 from the state 1234567, of its authors' program in C."""

KINDS = {
    "uniform": lambda draws, count: draws.uniform(count),
    "integers": lambda draws, count: draws.integers(1000, count),
    "normal": lambda draws, count: draws.normal(count),
    "kept": lambda draws, count: draws.kept(0.3, count),
}
every_kind = pytest.mark.parametrize("draw", KINDS.values(), ids=KINDS)


class OnDevice(Draws):
    """Makes its words as it would on a device."""

    def _words(self, count):
        first, self.taken = self.taken, self.taken + count
        numbers = torch.arange(first + 1, first + 1 + count) * _signed(GOLDEN)
        return _mixed_on_device(self._device_keys + numbers)


def word(key: int, k: int) -> int:
    """The k-th number of SplitMix64, from 1, after the state ``key`` (Steele, Lea and Flood, 2014)."""
    z = (key + k * 0x9E3779B97F4A7C15) % WORD
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % WORD
    z = (z ^ z >> 27) * 0x94D049BB133111EB % WORD
    return z ^ z >> 31


def key(seed: int, stream: int = 0) -> int:
    """The state that a member begins with."""
    return int(np.random.SeedSequence([seed, stream]).generate_state(1, np.uint64)[0])


def pieces(seed: int, bits: int, count: int, first: int = 0, stream: int = 0) -> list[int]:
    """Numbers of so many bits that a member draws from its word ``first`` on, the low bits of a word first."""
    each = 64 // bits
    found = (word(key(seed, stream), first + k // each + 1) >> bits * (k % each) for k in range(count))
    return [number % 2**bits for number in found]


def test_the_reference_gives_the_published_numbers():
    assert tuple(word(1234567, k) for k in range(1, 6)) == PUBLISHED


@pytest.mark.parametrize("kind", [Draws, OnDevice])
def test_words_are_the_published_numbers(kind):
    draws = kind([0])
    draws._keys[:] = 1234567  # the keys for a device share their memory
    assert tuple(int(each) % WORD for each in draws._words(5)[0]) == PUBLISHED


@pytest.mark.parametrize("kind", [Draws, OnDevice])
@pytest.mark.parametrize("count", [1, 2, 7, 30])
def test_numbers_are_those_worked_out_from_the_words(kind, count):
    draws, halves = kind(SEEDS, stream=3), (count + 1) // 2
    uniform = [[(piece // 2**9 + 0.5) / 2**23 for piece in pieces(seed, 32, count, 0, 3)] for seed in SEEDS]
    assert draws.uniform(count).tolist() == uniform
    integers = [[piece * 77 // 2**32 for piece in pieces(seed, 32, count, halves, 3)] for seed in SEEDS]
    assert draws.integers(77, count).tolist() == integers
    kept = [[float(piece >= 0.25 * 2**16) / 0.75 for piece in pieces(seed, 16, count, 2 * halves, 3)] for seed in SEEDS]
    torch.testing.assert_close(draws.kept(0.25, count), torch.tensor(kept), rtol=1e-6, atol=0)
    normal = draws.normal(count)
    shares = [[(piece // 2**9 + 0.5) / 2**23 for piece in pieces(seed, 32, count, 2 * halves + (count + 3) // 4, 3)]
              for seed in SEEDS]  # fmt: skip
    distribution = 0.5 * (1.0 + torch.erf(normal.double() / math.sqrt(2.0)))
    torch.testing.assert_close(distribution, torch.tensor(shares, dtype=torch.float64), rtol=0, atol=1e-6)


@every_kind
@pytest.mark.parametrize("count", [1, 5, 8, 101, 2 * AHEAD + 1, 9 * AHEAD])
def test_a_device_draws_the_same_numbers(draw, count):
    host, device = Draws(SEEDS), OnDevice(SEEDS)
    for _ in range(3):
        assert torch.equal(draw(host, count), draw(device, count))
        assert host.taken == device.taken


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@every_kind
def test_a_gpu_draws_the_same_numbers(draw):
    host, device = draw(Draws(SEEDS), 1001), draw(Draws(SEEDS, "cuda"), 1001)
    assert device.device.type == "cuda"
    torch.testing.assert_close(device.cpu(), host, rtol=1e-5, atol=1e-6)  # of normal numbers, their last bits differ


@every_kind
@pytest.mark.parametrize("count", [1, 3, 16, 101, 700])
@pytest.mark.parametrize("population", [2, 5])
def test_a_seed_draws_what_it_draws_alone(draw, count, population):
    together, alone = Draws(range(population)), [Draws([seed]) for seed in range(population)]
    for _ in range(4):
        drawn = draw(together, count)
        assert drawn.shape == (population, count)
        assert all(torch.equal(drawn[k : k + 1], draw(each, count)) for k, each in enumerate(alone))
        assert {each.taken for each in alone} == {together.taken}


@pytest.mark.parametrize("shape", [(), (3,), (2, 3), (2, 0), (4, 1, 5)])
def test_numbers_have_their_shape_behind_the_seeds(shape):
    draws, flat = Draws([3, 4]), Draws([3, 4])
    for whole, row in zip(
        (draws.uniform(*shape), draws.integers(9, *shape), draws.normal(*shape)),
        (flat.uniform(math.prod(shape)), flat.integers(9, math.prod(shape)), flat.normal(math.prod(shape))),
        strict=True,
    ):
        assert whole.shape == (2, *shape)
        assert torch.equal(whole.view(2, -1), row)


def test_a_draw_takes_whole_words():
    draws, taken = Draws([0]), []
    for count in (1, 2, 3, 4, 5):
        before = draws.taken
        draws.uniform(count)
        draws.kept(0.5, count)
        taken.append(draws.taken - before)
    assert taken == [1 + 1, 1 + 1, 2 + 1, 2 + 1, 3 + 2]  # two numbers of a word, four dropped units


@pytest.mark.parametrize("counts", [[3] * 2000, [AHEAD - 1, 4, AHEAD], [2 * AHEAD, 2 * AHEAD + 2], [10 * AHEAD + 5, 7]])
def test_numbers_that_are_made_ahead_are_the_next_ones(counts):
    """Every draw begins at the word behind the last one, on either side of the buffer's end."""
    draws = Draws([5])
    for count in counts:
        expected = [piece * 1000 // 2**32 for piece in pieces(5, 32, count, draws.taken)]
        assert draws.integers(1000, count)[0].tolist() == expected


@pytest.mark.parametrize("kind", [Draws, OnDevice])
@every_kind
def test_going_back_draws_the_same_again_and_going_on_skips(kind, draw):
    draws = kind([1, 2])
    draw(draws, 10)
    place = draws.taken
    once, following = draw(draws, 3001), draw(draws, 40)
    after = draws.taken
    draws.taken = place
    assert torch.equal(draw(draws, 3001), once)
    assert torch.equal(draw(draws, 40), following)
    fresh = kind([1, 2])
    fresh.taken = place
    assert torch.equal(draw(fresh, 3001), once)
    fresh.taken = 10**12  # far from what was made ahead
    draw(fresh, 5)
    fresh.taken = place
    assert torch.equal(draw(fresh, 3001), once)
    assert torch.equal(draw(fresh, 40), following)
    assert fresh.taken == after


@pytest.mark.parametrize("shape", [(), (1,), (3, 5), (700, 7)])
def test_what_is_skipped_would_have_been_drawn(shape):
    one, other = Draws([0, 1]), Draws([0, 1])
    one.normal(*shape)
    other.skip(*shape)
    assert one.taken == other.taken
    assert torch.equal(one.uniform(9), other.uniform(9))


@every_kind
def test_numbers_drawn_outlive_the_next_draw(draw):
    draws = Draws([0, 1])
    drawn = draw(draws, 50)
    before = drawn.clone()
    drawn.add_(0)  # they may be changed in place
    for _ in range(3 * AHEAD // 25):
        draw(draws, 50)
    assert torch.equal(drawn, before)


def test_streams_and_seeds_draw_apart():
    numbers = [Draws([seed], stream=stream).uniform(100).view(-1) for seed in (0, 1, 2) for stream in (0, 1, 2)]
    assert all(torch.equal(numbers[k], Draws([k // 3], stream=k % 3).uniform(100).view(-1)) for k in range(9))
    correlation = torch.corrcoef(torch.stack(numbers)).triu(1)
    assert 0.0 < correlation.abs().max() < 0.45  # 4.5 deviations of 100 independent pairs


# Distributions: every bound is one that a good generator exceeds once in a thousand seeds, or five deviations.


def chi_square(counts: torch.Tensor) -> float:
    expected = counts.double().mean()
    return float((counts - expected).square().sum() / expected)


def test_uniform_numbers_lie_between_0_and_1_and_are_equally_often_anywhere():
    drawn = Draws([0, 1]).uniform(100_000)
    assert drawn.dtype == torch.float32
    assert 0.0 < drawn.min() < 1e-4
    assert 1.0 - 1e-4 < drawn.max() < 1.0
    for each in drawn:
        assert chi_square((each * 100).long().bincount(minlength=100)) < 148.2  # 99 degrees of freedom
        lag = torch.corrcoef(torch.stack((each[1:], each[:-1])))[0, 1]
        assert abs(float(lag)) < 5 / 100_000**0.5


def test_the_least_and_the_greatest_uniform_numbers_have_finite_normal_ones():
    draws = Draws([0])
    for half, share in ((0, 2.0**-24), (2**32 - 1, 1.0 - 2.0**-24)):
        draws._halves = lambda count, half=half: np.full((1, count), half, dtype=np.uint32)
        assert float(draws.uniform()) == share
        assert abs(float(draws.normal())) == pytest.approx(5.294, abs=0.1)


@pytest.mark.parametrize("high", [1, 2, 10, 1000])
def test_whole_numbers_are_equally_often_each(high):
    drawn = Draws([3]).integers(high, 100_000)[0]
    assert drawn.dtype == torch.int64
    assert (drawn.min(), drawn.max()) == (0, high - 1)
    degrees = high - 1
    assert chi_square(drawn.bincount(minlength=high)) <= degrees + 5 * (2 * degrees) ** 0.5


@pytest.mark.parametrize("kind", [Draws, OnDevice])
@pytest.mark.parametrize("high", [10**6, 2**31 - 1])
def test_great_whole_numbers_reach_from_0_to_their_bound(kind, high):
    drawn = kind([3]).integers(high, 100_000)[0].double() / high
    assert 0.0 <= drawn.min() < 1e-4
    assert 1.0 - 1e-4 < drawn.max() < 1.0
    assert float(drawn.mean()) == pytest.approx(0.5, abs=5 * (1 / 12 / 100_000) ** 0.5)


def test_normal_numbers_have_mean_0_deviation_1_and_tails():
    drawn, count = Draws([2]).normal(200_000)[0].double(), 200_000
    assert abs(float(drawn.mean())) < 5 / count**0.5
    assert abs(float(drawn.square().mean()) - 1.0) < 5 * (2 / count) ** 0.5
    assert abs(float(drawn.pow(4).mean()) - 3.0) < 5 * (96 / count) ** 0.5
    for bound, share in ((1.0, 0.317311), (2.0, 0.0455003), (3.0, 0.0026998)):
        outside = float((drawn.abs() > bound).double().mean())
        assert abs(outside - share) < 5 * (share * (1 - share) / count) ** 0.5


@pytest.mark.parametrize("probability", [0.1, 0.5])
@pytest.mark.parametrize("kind", [Draws, OnDevice])
def test_each_unit_is_dropped_with_its_probability_and_by_itself(kind, probability):
    mask = kind([0]).kept(probability, 100_300).view(100, 1003)
    dropped = (mask == 0).double()
    deviation = (probability * (1 - probability) / mask.numel()) ** 0.5
    assert abs(float(dropped.mean()) - probability) < 5 * deviation + 2**-16
    torch.testing.assert_close(mask.unique(), torch.tensor([0.0, 1 / (1 - probability)]), rtol=1e-4, atol=0)
    for lag in (1, 2, 3, 4):  # four units share a word
        together = float((dropped[:, lag:] * dropped[:, :-lag]).mean())
        assert abs(together - probability**2) < 5 * (probability**2 / mask.numel()) ** 0.5


@pytest.mark.parametrize("kind", [Draws, OnDevice])
@pytest.mark.parametrize("probability", [0.1, 0.3, 0.95])
def test_the_probability_to_be_dropped_is_met_to_a_thousandth(kind, probability):
    """The mask keeps its mean: 2⁻¹⁶ of the probability is all that is rounded."""
    kept = float(kind([0]).kept(probability, 1000).max())
    assert 1 - 1 / kept == pytest.approx(probability, abs=1e-3 * probability)
