"""What the actor-critic methods share: their learner, and batches with demonstrations in them."""

from rled_agent.exploration.agent import Agent, Noise
from rled_agent.exploration.strategy import network_function
from rled_agent.learners.actor_losses import ActorLoss, policy_gradient
from rled_agent.learners.td3 import BatchPolicy, TD3Config, TD3Learner
from rled_agent.methods.method import Learning, Problem
from rled_agent.nn.policy import GateSettings
from rled_agent.replay.mixture import Mixture, Part
from rled_agent.replay.replay import Sampler
from rled_agent.uncertainty.uncertainty import Uncertainty, make_uncertainty


def actor_critic(
    problem: Problem,
    config: TD3Config,
    actor_loss: ActorLoss = policy_gradient,
    *,
    share: float = 0.0,
    preload: int = 0,
    proposal: BatchPolicy | None = None,
) -> Learning:
    """TD3 on a uniform replay.

    Args:
        problem: what it is built for.
        config: of the update.
        actor_loss: what the actor is improved by.
        share: of each batch that is drawn from the demonstrations.
        preload: demonstrated transitions that are put into the replay before the first step.
        proposal: another policy whose actions the targets may take.
    """
    sizes = problem.observation_size, problem.action_size
    learner = TD3Learner(*sizes, config, problem.draws, actor_loss, proposal)
    replay = problem.replay()
    batches: Sampler = replay
    if problem.demonstrations is not None:
        demonstrations = problem.demonstrations(config.gamma)
        if preload:
            replay.extend(demonstrations.sample(preload))
        if share:
            batches = Mixture(replay, Part(demonstrations, share))
    return Learning(learner, replay, batches, config.gamma)


def agent_strategy(
    problem: Problem, learner: TD3Learner, noise: float, uncertainty: Uncertainty | None = None
) -> Agent:
    """The learner's actor with exploration noise."""
    return Agent(network_function(learner.actor), Noise(noise, problem.draws), uncertainty)


def recorded_uncertainty(problem: Problem, learner: TD3Learner, passes: int) -> Uncertainty | None:
    """What estimates u_t for the record, where the actor drops units."""
    if not learner.actor.architecture.dropout:
        return None
    return make_uncertainty(GateSettings(passes=passes), learner.actor, None, problem.draws)
