"""What anyone would learn the cutting task with instead: stable-baselines3's PPO on C MuJoCo.

The environment is the simulation benchmark's (`mjx_cutting.sim.peers.GymCutting`) behind Gymnasium's
interface, one process each; settings are the library's own unless said, and the network is ours.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.peers import GymCutting

Predict = Callable[[np.ndarray], np.ndarray]
Episode = tuple[float, int, float]

SETTINGS: dict[str, Any] = {
    "n_steps": 256,
    "batch_size": 128,
    "n_epochs": 5,
    "learning_rate": 1e-3,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "ent_coef": 1e-4,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
}
"""The best of `learning_tuning.py --trials 8 --each-s 100` (experiments/results/learning_tuning.json)."""


class Cutting(gymnasium.Env[np.ndarray, np.ndarray]):
    """`GymCutting` with spaces and Gymnasium's reset."""

    def __init__(self, config: EnvConfig, seed: int = 0):
        self.inner = GymCutting(config, seed)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (15,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (5,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """A fresh episode."""
        return self.inner.reset(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One policy step."""
        return self.inner.step(action)


class _Episodes(BaseCallback):
    """Keeps time, steps and return of every episode that ended, and stops when the time is up."""

    def __init__(self, began: float, most_s: float):
        super().__init__()
        self.began, self.most_s = began, most_s
        self.ended: list[Episode] = []

    def _on_step(self) -> bool:
        now = time.perf_counter() - self.began
        for info in self.locals["infos"]:
            if "episode" in info:
                self.ended.append((now, int(self.num_timesteps), float(info["episode"]["r"])))
        return now < self.most_s


def train(
    config: EnvConfig,
    steps: int,
    processes: int,
    hidden: tuple[int, ...],
    discount: float,
    initial_std: float,
    most_s: float,
    chosen: dict[str, Any] = SETTINGS,
) -> tuple[list[Episode], dict[str, float], Predict]:
    """Train stable-baselines3's PPO.

    Returns: every episode as (seconds since the start, policy steps so far, return), {"wall_s", "steps",
    "steps_per_s"}, and the deterministic policy.
    """
    began = time.perf_counter()
    torch.set_num_threads(1)  # networks this small lose by more, and the cores are the environments'

    def make(rank: int) -> Callable[[], Monitor[Any, Any]]:
        return lambda: Monitor(Cutting(config, rank))

    vector = VecNormalize(SubprocVecEnv([make(i) for i in range(processes)]), gamma=discount)
    network = {
        "net_arch": {"pi": list(hidden), "vf": list(hidden)},
        "activation_fn": torch.nn.Tanh,
        "log_std_init": float(np.log(initial_std)),
    }
    settings = {**chosen, "gamma": discount, "policy_kwargs": network, "device": "cpu", "seed": 0}
    settings["n_steps"] = max(8, min(settings["n_steps"], steps // processes))
    settings["batch_size"] = min(settings["batch_size"], settings["n_steps"] * processes)
    learner = PPO("MlpPolicy", vector, **settings)
    kept = _Episodes(began, most_s)
    learner.learn(steps, callback=kept)
    wall_s = time.perf_counter() - began
    vector.close()
    vector.training = False

    def predict(observation: np.ndarray) -> np.ndarray:
        return np.asarray(learner.predict(vector.normalize_obs(observation), deterministic=True)[0])

    told = {"wall_s": wall_s, "steps": learner.num_timesteps, "steps_per_s": learner.num_timesteps / wall_s}
    return kept.ended, told, predict


def evaluate(config: EnvConfig, predict: Predict, episodes: int, seed: int = 1000) -> float:
    """Mean return of a policy [15] -> [5] on the peer's environment, the same episodes for every policy."""
    returns = []
    for i in range(episodes):
        env = Cutting(config, seed + i)
        observation, _ = env.reset()
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(predict(observation))
            total, over = total + reward, terminated or truncated
        returns.append(total)
    return float(np.mean(returns))
