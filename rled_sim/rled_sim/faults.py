"""Faults on purpose, those that section 3.5.2 of the thesis names: delays, noise, lost messages, what cannot be seen.

A ``FaultChannel`` lies between whoever acts and the simulation, in the node and in the Gymnasium wrapper alike, so one
seed gives the same faults in both. Without faults it draws nothing and changes nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from rled_msgs_py.errors import ContractError
from rled_msgs_py.params import described, param, parameters_of
from rled_msgs_py.validation import check_fields


def _steps(description: str) -> Any:
    return param(0, description, low=0, high=1000)


def _share(description: str) -> Any:
    return param(0.0, description, low=0.0, high=1.0)


@described
@dataclass(frozen=True)
class Faults:
    """Which faults there are; the same names are parameters of ``sim_node``."""

    observation_delay: int = _steps("steps after which a state is seen")
    observation_delay_spread: int = _steps("up to so many steps more, drawn for each state")
    control_delay: int = _steps("steps after which a displacement is carried out; until then the robot stays")
    control_delay_spread: int = _steps("up to so many steps more, drawn for each displacement")
    reward_delay: int = _steps("steps after which a reward is paid; the last step of an episode pays what is left")
    reward_delay_spread: int = _steps("up to so many steps more, drawn for each reward")
    sensor_noise: float = param(0.0, "standard deviation of the measured joint angles (rad)", low=0.0, high=1.0)
    actuator_noise: float = param(0.0, "standard deviation of a displacement, in units of Δq_max", low=0.0, high=10.0)
    observation_loss: float = _share("share of states that are lost: the one before is repeated in its place")
    command_loss: float = _share("share of displacements that are lost: the robot stays")
    command_repeat: float = _share("share of displacements in whose place the one before is repeated")
    hidden: str = param("", "what is not seen, in words: names of joints, ee, target; the middle of its range is seen")

    def __post_init__(self) -> None:
        check_fields(self)
        for each in parameters_of(Faults):
            each.spec.check(each.name, getattr(self, each.name))

    @property
    def any(self) -> bool:
        """There is a fault."""
        return any(getattr(self, each.name) != each.default for each in fields(Faults))


NO_FAULTS = Faults()


def require_faults(faults: object) -> None:
    """Refuse what is something else.

    Raises:
        ContractError: says what faults are.
    """
    if not isinstance(faults, Faults):
        raise ContractError(f"faults {faults!r}", "rled_sim.faults.Faults(...)")


def hidden_names(text: str, joint_names: Sequence[str]) -> list[str]:
    """What is hidden.

    Raises:
        ContractError: there is no such thing.
    """
    known, names = (*joint_names, "ee", "target"), text.split()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ContractError(f"hidden is '{' '.join(unknown)}'", ", ".join(known))
    return names
