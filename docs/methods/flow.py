"""A conditional flow as a planner, as somebody from outside would write it: it draws a trajectory, given p.

    python -m moe_policy.score flow:best --env PendulumSwingup-v0 --seeds 0 1 2      # in the folder of this file

Flow matching (Lipman et al., *Flow matching for generative modeling*, ICLR 2023): a network v(y, t, p) learns the
velocity y₁ − y₀ at y = (1 − t) y₀ + t y₁ between noise y₀ and a trajectory y₁, in the principal components of the
stored trajectories. A plan follows v from a draw of noise. A distribution may have two peaks where the optimum has two
sides, so that, unlike the prediction of a network, a draw from it need not lie between them. The method ``make`` takes
the first draw, ``best`` that of sixteen which violates dynamics and goal least.
"""

import numpy as np
import torch
from torch import nn

import moe_policy
from ocp_envs import OptimalControlProblem, Trajectory
from ocp_envs.solvers.check import verify

#: Principal components, hidden units, steps of training, batch, and steps of integration.
COMPONENTS, HIDDEN, STEPS, BATCH, INTEGRATION = 16, 256, 20_000, 256, 20


class Flow:
    """A flow from noise to trajectories of ``problem``, trained on the optima ``z`` (M, size) of ``p`` (M, np)."""

    def __init__(self, problem: OptimalControlProblem, p: np.ndarray, z: np.ndarray, seed: int) -> None:
        torch.manual_seed(seed)
        self.problem, self.seed, self.draws = problem, seed, 1
        self.centre, self.width = p.mean(axis=0), p.std(axis=0)
        self.mean, self.spread = z.mean(axis=0), np.where(z.std(axis=0) < 1e-3, 1.0, z.std(axis=0))
        standard = (z - self.mean) / self.spread
        _, size, self.axes = np.linalg.svd(standard, full_matrices=False)
        self.axes, self.size = self.axes[:COMPONENTS], size[:COMPONENTS] / np.sqrt(len(z))
        inputs = COMPONENTS + 1 + p.shape[1]
        self.velocity = nn.Sequential(
            *(nn.Linear(inputs, HIDDEN), nn.SiLU(), nn.Linear(HIDDEN, HIDDEN), nn.SiLU()),
            *(nn.Linear(HIDDEN, HIDDEN), nn.SiLU(), nn.Linear(HIDDEN, COMPONENTS)),
        )
        self.parameters_total = sum(weight.numel() for weight in self.velocity.parameters())
        self._train(self._scaled(p), torch.tensor(standard @ self.axes.T / self.size, dtype=torch.float32))

    def _scaled(self, p: np.ndarray) -> torch.Tensor:
        return torch.tensor((p - self.centre) / self.width, dtype=torch.float32)

    def _train(self, p: torch.Tensor, y: torch.Tensor) -> None:
        optimiser = torch.optim.AdamW(self.velocity.parameters(), 1e-3)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
        for _ in range(STEPS):
            rows = torch.randint(len(y), (BATCH,))
            noise, t = torch.randn(BATCH, COMPONENTS), torch.rand(BATCH, 1)
            predicted = self.velocity(torch.cat([noise + t * (y[rows] - noise), t, p[rows]], dim=1))
            loss = (predicted - (y[rows] - noise)).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()

    def __call__(self, parameters: np.ndarray) -> Trajectory:
        """A plan for each of ``parameters`` (B, np): of some draws the one that violates dynamics and goal least."""
        p = np.atleast_2d(parameters)
        plans = [self.problem.unflatten(self.draw(p, self.seed + 1000 * i)) for i in range(self.draws)]
        found = [verify(self.problem, p, plan) for plan in plans]
        best = np.argmin([check.defect + check.goal for check in found], axis=0)
        flat = np.stack([plan.flat() for plan in plans])
        return self.problem.unflatten(flat[best, np.arange(len(p))])

    @torch.no_grad()
    def draw(self, parameters: np.ndarray, seed: int) -> np.ndarray:
        """Flat plans of ``parameters`` (B, np), from the noise of ``seed``, the same for each row."""
        p = self._scaled(parameters)
        y = torch.randn(1, COMPONENTS, generator=torch.Generator().manual_seed(seed)).repeat(len(p), 1)
        for step in range(INTEGRATION):
            t = torch.full((len(p), 1), (step + 0.5) / INTEGRATION)
            half = y + self.velocity(torch.cat([y, t - 0.5 / INTEGRATION, p], dim=1)) / (2 * INTEGRATION)
            y = y + self.velocity(torch.cat([half, t, p], dim=1)) / INTEGRATION
        return y.double().numpy() * self.size @ self.axes * self.spread + self.mean


def make(problem: OptimalControlProblem, seed: int) -> Flow:
    """The method with one draw for ``problem``, trained on the solutions that are shipped with the package."""
    nearest = moe_policy.load(problem, "nearest", kind=moe_policy.NearestPlanner)
    return Flow(problem, nearest.parameters, nearest.trajectory.flat(), seed)


def best(problem: OptimalControlProblem, seed: int) -> Flow:
    """The method with the best of sixteen draws for ``problem``."""
    flow = make(problem, seed)
    flow.draws = 16
    return flow
