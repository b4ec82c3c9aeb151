"""`mjx-cutting export`: a trained policy as one file for the hardware, or the check of such a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from mjx_cutting.deploy.artefact import Artefact

NAME = "policy-export"
SUFFIXES = {"npz": ".npz", "onnx": ".onnx", "c": ".h"}


@dataclass(frozen=True)
class Export:
    """Writes a trained policy to one file for the hardware, and replays the golden pairs in it."""

    source: Annotated[Path, tyro.conf.Positional]
    """Run folder of train or adapt, or an exported .npz to be written in another format; with --verify, an
    exported .npz or .onnx, or a run folder with an exported .npz in it."""

    out: Path | None = None
    """File to write. Default: policy-export.npz, .onnx or .h in the run folder, or beside the source."""

    format: Literal["npz", "onnx", "c"] = "npz"
    """npz: for mjx_cutting.deploy.runtime, NumPy alone. onnx: opset 17. c: one C99 header, no dependency."""

    verify: bool = False
    """Write nothing: replay the golden pairs of an exported file on this machine."""

    pairs: int = 64
    """Golden pairs drawn at random, besides those at the clip edges."""

    seed: int = 0
    """Seed of the random golden pairs."""

    allow_failed_check: bool = False
    """Export a policy too that fails the check in C MuJoCo; the file says that it failed."""

    def run(self) -> int:
        """Writes the file; returns 0, or 1 where the golden pairs are not reproduced."""
        folder = self.source if self.source.is_dir() else self.source.parent
        if self.verify:
            return _verify(folder / f"{NAME}.npz" if self.source.is_dir() else self.source)
        artefact = self._artefact()
        out = self.out or folder / f"{NAME}{SUFFIXES[self.format]}"
        if self.format == "npz":
            from mjx_cutting.deploy.runtime import save_verified

            save_verified(artefact, out)
        elif self.format == "onnx":
            from mjx_cutting.deploy.onnx_model import write_onnx

            write_onnx(artefact, out)
        else:
            from mjx_cutting.deploy.c_header import write_c_header

            write_c_header(artefact, out)
        print(f"{artefact.observation_size} observations, {artefact.action_size} actions: {out}")
        if self.format == "c":
            print(f"mjx_cutting_policy_verify() in it replays golden pairs; SHA-256 {artefact.sha256}")
            return 0
        return _verify(out)

    def _artefact(self) -> Artefact:
        if self.source.is_file():
            from mjx_cutting.deploy.artefact import Artefact

            return Artefact.load(self.source)
        from mjx_cutting.deploy.export import build_run

        artefact = build_run(
            self.source, pairs=self.pairs, seed=self.seed, allow_failed_check=self.allow_failed_check
        )
        verdict = artefact.provenance["sim_to_sim"]
        word = {True: "passed", False: "FAILED", None: "not flown"}[verdict["passed"]]
        print("; ".join([f"check in C MuJoCo: {word}", *verdict["reasons"]]))
        return artefact


def _verify(path: Path) -> int:
    from mjx_cutting.deploy.runtime import TOLERANCE, verify

    if path.suffix == ".onnx":
        from mjx_cutting.deploy.onnx_model import verify_onnx

        result = verify_onnx(path)
    else:
        result = verify(path)
    verdict = "reproduced" if result.passed else "NOT reproduced"
    print(
        f"{result.pairs} golden pairs {verdict}: worst difference {result.worst:.1e} of an action's range, "
        f"allowed {TOLERANCE:.0e}; SHA-256 {result.sha256}"
    )
    return 0 if result.passed else 1
