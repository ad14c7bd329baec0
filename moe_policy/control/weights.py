"""Weights of LQR tracking, and those chosen for the shipped problems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.support.doors import checked
from ocp_envs.system import Box


@checked
@dataclass(frozen=True, eq=False)
class TrackingWeights:
    """Weights of the tracking cost Σ δxᵀQδx + δuᵀRδu, one term per control step.

    R may grow where the plan leaves little control authority. By Bryson's rule, the weight of a quantity is the inverse
    square of its acceptable deviation (Bryson & Ho, *Applied Optimal Control*, section 5.2), and a correction that is
    clipped has no effect. With ρ the distance of ū to the nearer bound, relative to that of the centre of the box,

        R_k = R / max(ρ_k, authority)².

    Args:
        state: diagonal of Q, (nx,).
        control: diagonal of R, (nu,), positive.
        terminal: weight of the error at the end of a plan, (nx, nx); by default the solution of the algebraic Riccati
            equation at the goal, which is the cost-to-go of terminal regulation, and 10 Q where the problem has none.
        authority: lower bound of ρ, in (0, 1]; 1 for a constant R.

    Raises:
        ValueError: values that are not finite or outside their range.
    """

    state: Array
    control: Array
    terminal: Array | None = None
    authority: float = 1.0

    def __post_init__(self) -> None:
        for name in ("state", "control", "terminal"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_array(value))
        if not (np.isfinite(self.state).all() and (self.state >= 0).all()):
            raise ValueError(f"state weights must be finite and not negative, got {self.state}")
        if not (np.isfinite(self.control).all() and (self.control > 0).all()):
            raise ValueError(f"control weights must be finite and positive, got {self.control}")
        if not 0 < self.authority <= 1:
            raise ValueError(f"authority must lie in (0, 1], got {self.authority}")

    @classmethod
    @checked
    def uniform(
        cls,
        problem: ProblemOrId,
        state: float = 10.0,
        control: float = 0.1,
        terminal: float | None = None,
        authority: float = 1.0,
    ) -> TrackingWeights:
        """Multiples of the identity for ``problem``, in SI units: ``state`` · I, ``control`` · I, ``terminal`` · I.

        Without a factor ``terminal`` that weight is the default of the class, which also explains ``authority``.
        """
        problem = problem_of(problem)
        nx, nu = problem.system.nx, problem.system.nu
        end = None if terminal is None else terminal * np.eye(nx)
        return cls(np.full(nx, state), np.full(nu, control), end, authority)

    @classmethod
    @checked
    def default(cls, problem: ProblemOrId) -> TrackingWeights:
        """The weights of :data:`CHOSEN` for ``problem``; of any other Q = 10 / scale² and R = 0.1 / scale².

        This is Bryson's rule with the scales of the coordinates, so that it does not depend on their units.
        """
        problem = problem_of(problem)
        if problem.id in CHOSEN:
            return cls.uniform(problem, **CHOSEN[problem.id])
        system = problem.system
        return cls(10.0 / system.state.scale**2, 0.1 / system.control.scale**2)

    def control_at(self, controls: Array, box: Box) -> Array:
        """Diagonals of R_k, (..., nu), for feed-forward ``controls`` ū, (..., nu), in their ``box``."""
        authority = 2 * np.minimum(controls - box.lower, box.upper - controls) / box.width
        return np.asarray(self.control / np.maximum(authority, self.authority) ** 2)


#: Arguments of :meth:`TrackingWeights.uniform` by environment, where others than its defaults perform better on the
#: development set (``scripts/choose_tracking.py``). The quadcopter corrects lateral errors by tilting, which takes
#: time: a large terminal weight makes it begin early. Climbing plans end with the rotors off, without any control
#: authority.
_FLIGHT = MappingProxyType({"state": 1.0, "control": 10.0, "terminal": 1e5, "authority": 0.1})
CHOSEN: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "PendulumSwingup-v0": MappingProxyType({}),
        "GroundVehicle-v0": MappingProxyType({}),
        "Quadcopter-v0": _FLIGHT,
        "QuadcopterObstacle-v0": _FLIGHT,
    }
)
