"""The disturbance process measured: accuracy against dense, time, memory, calibration, and peers beside it.

    python benchmarks/disturbance_gp.py [--quick] [--json FILE]

Synthetic trials with known hyperparameters: 14 trials of 2,500 stamps at 500 Hz, 35,000 samples an axis. The
fit's cold time and peak memory are taken in a process of their own without a compile cache; peers
(scikit-learn, GPyTorch, celerite2, tinygp) in another, each reported as absent where not installed. `--quick`
shrinks seeds, simulations and sizes of the peers, never the 35,000-sample figures. Figures depend on what
else the machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
import tinygp
from gp_peers import best_seconds, peers_seconds

import mjx_cutting.disturbance as disturbance
from mjx_cutting import _platform
from mjx_cutting.disturbance import search
from mjx_cutting.disturbance.kernel import PeriodicKernel, fourier, prior
from mjx_cutting.disturbance.likelihood import Hyper, log_likelihood
from mjx_cutting.disturbance.solver import FiniteRankSolver, predict
from mjx_cutting.disturbance.statistics import reduce

FREQUENCY_HZ = 2.13
TRUTH = {"length": 0.5, "amplitude": 1.0, "trial_length": 0.6, "trial_amplitude": 0.5, "noise": 0.6}


def simulate(seed: int, trials=14, stamps=2500, rate_hz=500.0, axes=3, frequency_hz=FREQUENCY_HZ, **changes):
    """Returns (time [N], residual [R, N, A], new_trial [N, A]): trials of the model, and an unseen one."""
    h = TRUTH | changes
    rng = np.random.default_rng(seed)
    time_s = np.arange(stamps) / rate_hz
    phi = fourier(time_s, frequency_hz)
    common = rng.normal(size=(axes, 65)) * np.sqrt(prior(h["length"])) * h["amplitude"]
    spread = np.sqrt(prior(h["trial_length"])) * h["trial_amplitude"]
    own = rng.normal(size=(trials + 1, axes, 65)) * spread
    latent = np.einsum("nm,ram->rna", phi, common + own)
    return time_s, latent[:-1] + h["noise"] * rng.normal(size=latent[:-1].shape), latent[-1]


def accuracy() -> dict[str, float]:
    """Worst differences from tinygp's dense process at n = 1,000 and at 3,500 replicated samples."""
    rng = np.random.default_rng(0)
    t = jnp.asarray(np.sort(rng.uniform(0, 5, 1000)))
    y = jnp.sin(2 * jnp.pi * t / 0.47) + 0.3 * jnp.asarray(rng.normal(size=1000))
    theta, test = jnp.asarray([0.47, 0.6, 1.3, 0.3]), jnp.linspace(-1.0, 8.0, 50)

    def ours(p):
        kernel = PeriodicKernel(p[0], p[1], p[2])
        return tinygp.GaussianProcess(kernel, t, diag=p[3] ** 2, solver=FiniteRankSolver)

    def dense(p, x=t):
        kernel = p[2] ** 2 * tinygp.kernels.ExpSineSquared(scale=p[0], gamma=2 / p[1] ** 2)
        return tinygp.GaussianProcess(kernel, x, diag=p[3] ** 2)

    value, slope = jax.value_and_grad(lambda p: ours(p).log_probability(y))(theta)
    true, true_slope = jax.value_and_grad(lambda p: dense(p).log_probability(y))(theta)
    mean, variance = predict(ours(theta), y, test)
    expected = dense(theta).condition(y, test, diag=jnp.asarray(0.0)).gp
    K = np.asarray(dense(theta).covariance)
    root = np.asarray(ours(theta).solver.dot_triangular(jnp.eye(1000)))
    stamps = np.arange(250) * 0.02
    residual = np.sin(2 * np.pi * 2.1 * stamps)[None, :, None] + 0.4 * rng.normal(size=(14, 250, 1))
    reduced = reduce(stamps, residual, False)
    rows = search.rows_of(reduced)
    at = jnp.asarray([1 / 2.1, 0.7, 0.9, 0.5])

    def replicated(p):
        hyper = Hyper(1 / p[0], p[1:2], p[2:3], p[1:2], p[2:3], p[3:4])
        return log_likelihood(hyper, rows, "pooled", 32)

    x, flat = jnp.asarray(np.tile(stamps, 14)), jnp.asarray(reduced.residual[..., 0].ravel())
    many, many_slope = jax.value_and_grad(replicated)(at)
    true_many, true_many_slope = jax.value_and_grad(lambda p: dense(p, x).log_probability(flat))(at)
    return {
        "loglik_absolute": float(max(abs(value - true), abs(many - true_many))),
        "loglik_relative": float(max(abs(value / true - 1), abs(many / true_many - 1))),
        "gradient_relative": float(
            max(jnp.max(jnp.abs(slope / true_slope - 1)), jnp.max(jnp.abs(many_slope / true_many_slope - 1)))
        ),
        "mean_absolute": float(jnp.max(jnp.abs(mean - expected.loc))),
        "variance_relative": float(jnp.max(jnp.abs(variance / expected.variance - 1))),
        "square_root_relative": float(np.max(np.abs(root @ root.T - K)) / np.abs(K).max()),
    }


def likelihood_times() -> dict[str, float]:
    """Milliseconds of one likelihood with its gradient at 35,000 samples, J = 32."""
    time_s, residual, _ = simulate(0)
    found = {}
    one = np.ones(3)
    for name, axes, effects in (("1_axis_pooled", 1, False), ("3_axes_trial_effects", 3, True)):
        reduced = reduce(time_s, residual[..., :axes], effects)
        rows = search.rows_of(reduced)
        hyper = Hyper(FREQUENCY_HZ, *(v * one[:axes] for v in (0.5, 0.8, 0.6, 0.4, 0.5)))
        hyper = jax.tree.map(jnp.asarray, hyper)
        layout = reduced.effects
        call = jax.jit(jax.value_and_grad(lambda h, r, layout=layout: log_likelihood(h, r, layout, 32)))
        found[name] = 1e3 * best_seconds(lambda call=call, h=hyper, r=rows: call(h, r), 30)
    x, y = jnp.asarray(np.tile(time_s, 14)), jnp.asarray(residual[..., 0].ravel())

    @jax.jit
    @jax.value_and_grad
    def public(p):
        kernel = PeriodicKernel(p[0], p[1], p[2])
        return tinygp.GaussianProcess(kernel, x, diag=p[3] ** 2, solver=FiniteRankSolver).log_probability(y)

    found["public_interface_1_axis"] = 1e3 * best_seconds(
        lambda: public(jnp.asarray([1 / FREQUENCY_HZ, 0.5, 0.8, 0.5])), 5
    )
    return found


def best_fit(time_s, residual, repeats: int = 3, **options: Any) -> float:
    """Returns the least seconds of `repeats` fits after one that compiles."""
    seconds = []
    for _ in range(1 + repeats):
        start = time.perf_counter()
        disturbance.fit(time_s, residual, diagnose=False, **options)
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])


def fit_times(quick: bool) -> dict[str, float]:
    """Seconds of the whole search (scan, 32 starts, trial effects, Laplace), and at ten times the samples."""
    time_s, residual, _ = simulate(1)
    found = {"warm_3_axes": best_fit(time_s, residual)}
    found["warm_1_axis_pooled"] = best_fit(time_s, residual[..., :1], trial_effects=False)
    # ten times the samples: ten times the stamps, at ten times the rate, over the same frequencies
    looked = (0.4, 2.9 if quick else 24.6)
    seconds = []
    for factor in (1, 10):
        many_s, many, _ = simulate(1, stamps=2500 * factor, rate_hz=500.0 * factor)
        seconds.append(best_fit(many_s, many, frequency_range_hz=looked))
    found["seconds_35000"], found["seconds_350000"] = seconds
    found["ratio_350000_to_35000"] = seconds[1] / seconds[0]
    return found


def cold() -> dict[str, float]:
    """The fit in this fresh process: seconds from the call, and peak memory, MB."""
    time_s, residual, _ = simulate(1)
    start = time.perf_counter()
    gp = disturbance.fit(time_s, residual, diagnose=False)
    seconds = time.perf_counter() - start
    assert abs(gp.frequency_hz - FREQUENCY_HZ) < 0.01
    return {"seconds": seconds, "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def draws(quick: bool) -> dict[str, float]:
    """One step of 4,096 environments on 3 axes, beside a dense posterior evaluated at each step."""
    time_s, residual, _ = simulate(2)
    gp = disturbance.fit(time_s, residual, diagnose=False)
    with_all = disturbance.PeriodicPosterior.build(
        gp.weights_mean_n.T, gp.weights_factor_n, gp.weights_trial_factor_n, gp.noise_std_n, gp.frequency_hz
    )
    envs, steps = 4096, 200
    found: dict[str, float] = {}
    for name, posterior in (("32_harmonics", with_all), ("pruned", gp.posterior())):
        keys = jax.random.split(jax.random.key(0), envs)
        reset = jax.jit(jax.vmap(posterior.draw))
        state = reset(keys)

        @jax.jit
        def run(state, posterior=posterior):
            def step(state, _):
                value = jax.vmap(posterior.value)(state)
                return jax.vmap(lambda d: posterior.advance(d, 0.002))(state), value.sum(0)  # all are used

            return jax.lax.scan(step, state, None, length=steps)[1]

        found[f"step_ms_{name}"] = 1e3 * best_seconds(lambda run=run, s=state: run(s), 5) / steps
        found[f"reset_ms_{name}"] = 1e3 * best_seconds(lambda reset=reset, k=keys: reset(k), 5)
        found[f"harmonics_{name}"] = posterior.harmonics
    text = jax.jit(jax.vmap(lambda k: with_all.value(with_all.draw(k)))).lower(keys).as_text().lower()
    found["lapack_calls_in_reset_and_step"] = float(text.count("lapack") + text.count("cholesky"))
    found |= naive_step(1000 if quick else 2500, envs)
    found["naive_over_ours"] = found["naive_dense_step_ms"] / found["step_ms_32_harmonics"]
    draw = with_all.draw(jax.random.key(0), "mean", random_phase=False)
    last = jax.lax.fori_loop(0, 2500, lambda _, d: with_all.advance(d, 0.002), draw)
    exact = (gp.frequency_hz * 0.002 * 2500) % 1.0
    found["phase_error_turns_2500_steps"] = abs((int(last.phase) / 2**32 - exact + 0.5) % 1.0 - 0.5)
    return found


def naive_step(n: int, envs: int) -> dict[str, float]:
    """A dense posterior on n samples evaluated at one time in each environment, axis by axis, fresh noise.

    n is the number of distinct stamps: on all 35,000 samples the factor alone would take 9.8 GB.
    """
    x = np.arange(n) * (5.0 / n)
    K = np.exp(-2 * np.sin(np.pi * (x[:, None] - x) * FREQUENCY_HZ) ** 2 / 0.25) + 0.36 / 14 * np.eye(n)
    factor = jnp.asarray(np.linalg.cholesky(K), jnp.float32)
    alpha = jnp.asarray(np.linalg.solve(K, np.ones(n)), jnp.float32)
    stamps = jnp.asarray(x, jnp.float32)

    def axis(at, scale, key):
        k = scale * jnp.exp(-2 * jnp.sin(jnp.pi * (at[:, None] - stamps) * FREQUENCY_HZ) ** 2 / 0.25)
        half = jax.scipy.linalg.solve_triangular(factor, k.T, lower=True)
        spread = jnp.sqrt(jnp.maximum(1.0 - jnp.sum(half**2, 0), 0.0))
        return k @ alpha + spread * jax.random.normal(key, at.shape)

    @jax.jit
    def naive(at, keys):
        return jnp.stack([axis(at, 1.0 + a, keys[a]) for a in range(3)], 1)

    at, keys = jnp.linspace(0, 5, envs, dtype=jnp.float32), jax.random.split(jax.random.key(0), 3)
    measured = best_seconds(lambda: naive(at, keys), 2)
    return {"naive_dense_samples": n, "naive_dense_step_ms": 1e3 * measured}


def seeds(count: int) -> dict[str, Any]:
    """How often the search is at or below the truth's negative log likelihood, and where the period is."""
    better, within, warped_within, gaps = 0, 0, 0, []
    for seed in range(count):
        frequency = float(np.random.default_rng(1000 + seed).uniform(0.8, 8.0))
        time_s, residual, _ = simulate(seed, frequency_hz=frequency)
        gp = disturbance.fit(time_s, residual, diagnose=False)
        with _platform.x64():
            reduced = reduce(time_s, residual)
            one, scale = np.ones(3), reduced.scale
            truth = Hyper(
                frequency, 0.5 * one, 1.0 / scale, 0.6 * one, 0.5 / scale, 0.6 / scale,
            )  # fmt: skip
            true = float(log_likelihood(truth, search.rows_of(reduced), "balanced", 32))
        true -= reduced.count * float(np.sum(np.log(scale)))
        gaps.append(true - gp.log_likelihood)
        better += gaps[-1] <= 0.5
        within += abs(gp.frequency_hz - frequency) <= 4 * gp.standard_errors["frequency_hz"]
        bend = 0.15 / frequency * np.sin(np.pi * time_s / time_s[-1])
        warped = np.stack([
            np.stack([np.interp(time_s + bend * np.sin(7 * r), time_s, trial[:, a]) for a in range(3)], 1)
            for r, trial in enumerate(residual)
        ])  # fmt: skip
        again = disturbance.fit(time_s, warped, diagnose=False)
        warped_within += abs(again.period_s * frequency - 1) < 0.01
    return {
        "count": count,
        "at_or_below_truth_plus_half": better,
        "period_within_4_standard_errors": within,
        "period_within_1_percent_warped": warped_within,
        "largest_gap_nats": float(max(gaps)),
    }


def coverage(count: int) -> dict[str, float]:
    """Share of a new trial's latent force inside the 95 % band, hierarchical and pooled."""
    found = {}
    for own in (0.5, 1.5):
        inside = {True: [], False: []}
        for seed in range(count):
            time_s, residual, fresh = simulate(
                seed, trials=8, stamps=400, rate_hz=80.0, axes=3, trial_amplitude=own
            )
            for effects in (True, False):
                gp = disturbance.fit(
                    time_s,
                    residual,
                    trial_effects=effects,
                    frequency_range_hz=(1.8, 2.5),
                    starts=4,
                    diagnose=False,
                )
                mean, spread = gp.predict(time_s)
                inside[effects].append(np.mean(np.abs(fresh - mean) < 1.96 * spread))
        found[f"trial_effects_s1_{own}"] = float(np.mean(inside[True]))
        found[f"pooled_s1_{own}"] = float(np.mean(inside[False]))
    found["simulations"] = count
    return found


def apart(what: str, quick: bool) -> dict[str, Any]:
    """Returns the figures of one part run in a process of its own, without a compile cache."""
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, __file__, "--only", what] + (["--quick"] if quick else [])
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if ran.returncode:
        return {"failed": ran.stderr[-2000:]}
    return json.loads(ran.stdout.splitlines()[-1])


def main() -> None:
    """Runs the parts and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer seeds and simulations, smaller peers")
    parser.add_argument("--json", metavar="FILE", help="also write the figures to FILE")
    parser.add_argument("--parts", nargs="+", help="measure these anew, the others being those in FILE")
    parser.add_argument("--only", choices=("cold", "peers"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    quick = arguments.quick
    if arguments.only:
        time_s, residual, _ = simulate(0, axes=1)
        samples = np.tile(time_s, 14), residual[..., 0].ravel()
        found_apart = cold() if arguments.only == "cold" else peers_seconds(*samples, FREQUENCY_HZ, quick)
        print(json.dumps(found_apart))
        return
    found: dict[str, Any] = {
        "command": " ".join(["python", "benchmarks/disturbance_gp.py", *sys.argv[1:]]),
        "quick": quick,
        "machine": {
            "processor": platform.machine(),
            "cpus": os.cpu_count(),
            "load_1_min": os.getloadavg()[0],
        },
        "versions": _platform.versions(),
        "timing": "least of several repeats: other work on the machine can only lengthen a time",
    }

    if arguments.parts:
        with open(arguments.json) as file:
            found = json.load(file) | {"again": {key: found[key] for key in ("command", "machine")}}

    def part(name: str, call: Callable[[], Any]) -> None:
        if arguments.parts and name not in arguments.parts:
            return
        start = time.perf_counter()
        found[name] = call()
        print(f"{name} ({time.perf_counter() - start:.0f} s)")
        for key, value in found[name].items():
            print(f"  {key}: {value:.4g}" if isinstance(value, float) else f"  {key}: {value}")

    part("cold", lambda: min((apart("cold", quick) for _ in range(2)), key=lambda f: f.get("seconds", 1e9)))
    with _platform.x64():
        part("accuracy_against_dense", accuracy)
        part("likelihood_and_gradient_ms", likelihood_times)
    part("fit", lambda: fit_times(quick))
    part("draws", lambda: draws(quick))
    part("seeds", lambda: seeds(2 if quick else 20))
    part("new_trial_latent_coverage_95", lambda: coverage(5 if quick else 100))
    part("peers", lambda: apart("peers", quick))
    found |= {
        "fit_seconds_35000": found["fit"]["warm_3_axes"],
        "fit_seconds_35000_cold": found["cold"].get("seconds"),
        "loglik_relative_error_vs_dense": found["accuracy_against_dense"]["loglik_relative"],
        "draw_ns_per_env_step": 1e6 * found["draws"]["step_ms_32_harmonics"] / 4096,
        "peak_rss_mb": found["cold"].get("peak_rss_mb"),
    }
    for key in (
        "fit_seconds_35000",
        "fit_seconds_35000_cold",
        "loglik_relative_error_vs_dense",
        "draw_ns_per_env_step",
        "peak_rss_mb",
    ):
        print(f"{key}: {found[key]}")
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(found, file, indent=2)
            file.write("\n")


if __name__ == "__main__":
    main()
