"""Sizes of a training, by name. What each was chosen for, and what it reached, stands beside it.

The figures were measured with `python -m experiments.expert --preset NAME`; see docs/learning.md.
"""

from __future__ import annotations

from mjx_cutting.learning.settings import ImitationConfig, PPOConfig, require

EXPERT = {
    # Seconds: does it run at all. Without a schedule, so that a run can also be made longer.
    "smoke": PPOConfig(
        steps=512,
        envs=8,
        unroll_length=16,
        minibatches=2,
        epochs=1,
        noise_scale_final=1.0,
        hidden=(16,),
        value_hidden=(16,),
    ),
    # Within the five minutes of `mjx-cutting demo` on two cores.
    "demo": PPOConfig(steps=400_000, envs=32, minibatches=4, learning_rate_final=1e-4),
    # An expert for the experiment on two cores.
    "cpu": PPOConfig(steps=4_000_000, learning_rate_final=1e-4, value_hidden=(128, 128)),
    # The paper's 16 million policy steps.
    "full": PPOConfig(
        steps=16_000_000, envs=256, minibatches=32, learning_rate_final=1e-4, value_hidden=(128, 128)
    ),
}

# The paper's 50 episodes of about 500 steps, a learning rate of 1e-3 and batches of 64.
FINE_TUNE = {
    "smoke": PPOConfig(steps=256, envs=4, unroll_length=16, minibatches=2, epochs=1),
    "demo": PPOConfig(steps=25_600, envs=10, minibatches=10, noise_scale=0.3),
    "cpu": PPOConfig(steps=25_600, envs=10, minibatches=10, noise_scale=0.3),
    "full": PPOConfig(steps=25_600, envs=10, minibatches=10, noise_scale=0.3),
}

# What the loop fine-tunes with: four times the steps, smaller ones, since the paper's settings make an expert
# worse even where there is nothing to learn; so does a rate of 3e-4, a little (experiments/fine_tuning.py).
_REFINE = PPOConfig(
    steps=100_000, envs=32, minibatches=4, learning_rate=1e-4, learning_rate_final=3e-5, noise_scale=0.5
)
REFINE = {"smoke": FINE_TUNE["smoke"], "demo": _REFINE, "cpu": _REFINE, "full": _REFINE}

IMITATION = {
    "smoke": ImitationConfig(rounds=2, envs=2, expert_rounds=1),
    "demo": ImitationConfig(rounds=10, envs=8, expert_rounds=8),
    "cpu": ImitationConfig(),
    "full": ImitationConfig(),
}

NAMES = tuple(EXPERT)


def check(preset: str) -> None:
    """Raise ValueError when there is no such preset."""
    require("preset", preset, preset in NAMES, f"one of {NAMES}")
