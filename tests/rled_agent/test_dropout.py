import numpy as np
import pytest
import torch
from rled_agent.nn.dropout import dropout_masks

MAKERS = [
    pytest.param(lambda seed: torch.Generator().manual_seed(seed), id="torch"),
    pytest.param(np.random.default_rng, id="numpy"),
]


def mask_of(count, probability, generator):
    return dropout_masks([(count,)], probability, generator)[0]


@pytest.mark.parametrize("probability", [0.1, 0.5])
@pytest.mark.parametrize("generator", MAKERS)
def test_each_unit_is_dropped_with_its_probability_and_by_itself(generator, probability):
    mask = mask_of(100_300, probability, generator(0)).view(100, 1003)
    dropped = (mask == 0).double()
    deviation = (probability * (1 - probability) / mask.numel()) ** 0.5
    assert abs(float(dropped.mean()) - probability) < 5 * deviation + 2**-16
    torch.testing.assert_close(mask.unique(), torch.tensor([0.0, 1 / (1 - probability)]), rtol=1e-4, atol=0)
    for lag in (1, 2, 3, 4):  # four units share a draw
        together = float((dropped[:, lag:] * dropped[:, :-lag]).mean())
        assert abs(together - probability**2) < 5 * (probability**2 / mask.numel()) ** 0.5


@pytest.mark.parametrize("probability", [0.1, 0.3, 0.95])
def test_the_probability_is_met_to_a_thousandth(probability):
    """The mask keeps its mean: 2⁻¹⁶ of the probability is all that is rounded."""
    kept = float(mask_of(1000, probability, np.random.default_rng(0)).max())
    assert 1 - 1 / kept == pytest.approx(probability, abs=1e-3 * probability)


@pytest.mark.parametrize("generator", MAKERS)
def test_the_same_generator_state_drops_the_same_units(generator):
    one, same, other = (mask_of(105, 0.3, generator(seed)) for seed in (4, 4, 5))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


@pytest.mark.parametrize("generator", MAKERS)
def test_the_next_mask_is_another_one(generator):
    drawing = generator(4)
    assert not torch.equal(mask_of(105, 0.3, drawing), mask_of(105, 0.3, drawing))


def test_several_masks_are_one_draw_in_parts():
    first, second = dropout_masks([(2, 3, 5), (2, 3, 2)], 0.3, np.random.default_rng(1))
    assert (first.shape, second.shape) == ((2, 3, 5), (2, 3, 2))
    assert torch.equal(torch.cat([first.flatten(), second.flatten()]), mask_of(42, 0.3, np.random.default_rng(1)))
