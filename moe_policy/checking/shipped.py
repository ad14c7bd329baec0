"""The checked planners that are shipped: which mixture each wraps, and how it tries and repairs plans.

Chosen on the development sets with ``scripts/check_planners.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from moe_policy.checking.checked import Checked
    from moe_policy.protocols import Planner


@dataclass(frozen=True)
class Settings:
    """What a shipped checked planner is made of.

    Args:
        planner: name of the mixture.
        experts: number of experts that are tried.
        margins: names of parameters and amounts by which they are enlarged, for further plans of each expert.
        iterations, rounds, margin: see :class:`~moe_policy.checking.remedies.Repair`.
    """

    planner: str
    experts: int = 2
    margins: tuple[tuple[str, float], ...] = ()
    iterations: int = 10
    rounds: int = 3
    margin: float = 0.0

    def checked(self, planner: Planner, nearest: Planner | None) -> Checked:
        """The checked planner that wraps the mixture ``planner`` and solves from the plan of ``nearest``, too."""
        from moe_policy.checking.checked import Checked
        from moe_policy.checking.remedies import Repair
        from moe_policy.planners.margin import Margin

        margins = [Margin(parameter, amount) for parameter, amount in self.margins]
        repair = Repair(self.iterations, self.rounds, self.margin)
        return Checked(planner, experts=self.experts, margins=margins, repair=repair, nearest=nearest, name="checked")


#: By problem; the others have none.
SHIPPED: Mapping[str, Settings] = MappingProxyType(
    {
        "PendulumSwingup-v0": Settings("moe-kmeans-4"),
        "GroundVehicle-v0": Settings("moe-kmeans-10"),
        "Quadcopter-v0": Settings("moe-kmeans-4"),
        "QuadcopterObstacle-v0": Settings("moe-custom", margins=(("radius", 0.1),), iterations=5, margin=0.03),
        "PendulumUncertain-v0": Settings("moe-kmeans-10"),
        "CartPoleSwingup-v0": Settings("moe-custom"),
        "RocketLanding-v0": Settings("moe-kmeans-4"),
        "TwoLinkArm-v0": Settings("moe-auto"),
        "PlanarQuadcopterDiscs-v0": Settings("moe-custom", margin=0.01),
        "QuadcopterRecovery-v0": Settings("moe-kmeans-4"),
    }
)
