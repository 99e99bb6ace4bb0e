import pytest
import torch
from rled_agent.adam import Adam


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_fifty_steps_equal_those_of_torch(dtype):
    generator = torch.Generator().manual_seed(0)
    start = torch.randn(40, generator=generator, dtype=dtype)
    mine, gradients, theirs = start.clone(), torch.zeros(40, dtype=dtype), torch.nn.Parameter(start.clone())
    adam = Adam(mine, gradients)
    reference = torch.optim.Adam([theirs], lr=1.0)
    for k in range(50):
        rate = 1e-2 / (1 + k / 10)
        gradients.copy_(torch.randn(40, generator=generator, dtype=dtype) + 0.3 * mine)
        theirs.grad = gradients.clone()
        reference.param_groups[0]["lr"] = rate
        adam.step(rate)
        reference.step()
    torch.testing.assert_close(mine, theirs.detach(), rtol=1e-5 if dtype is torch.float32 else 1e-12, atol=1e-7)
    assert adam.tensors()["steps"] == 50


def test_the_first_step_is_the_rate_against_the_sign_of_the_gradient():
    parameters = torch.tensor([1.0, 1.0, 1.0])
    Adam(parameters, torch.tensor([0.5, -3.0, 0.0])).step(0.1)
    torch.testing.assert_close(parameters, torch.tensor([0.9, 1.1, 1.0]))


def test_its_tensors_are_all_its_state():
    gradients = torch.tensor([0.5, -3.0])
    one, other = (Adam(torch.ones(2), gradients) for _ in range(2))
    one.step(0.1)
    for name, tensor in one.tensors().items():
        other.tensors()[name].copy_(tensor)
    other.parameters.copy_(one.parameters)
    for each in (one, other):
        each.step(0.1)
    assert torch.equal(one.parameters, other.parameters)
