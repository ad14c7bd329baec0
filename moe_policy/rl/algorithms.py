"""The learners by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from moe_policy.rl.cloning import CloningSettings
from moe_policy.rl.common import LearnerSettings
from moe_policy.rl.settings import ClonedPPOSettings, PPOSettings, SACSettings, TQCSettings

#: The settings of every algorithm.
ALGORITHMS: Mapping[str, type[LearnerSettings]] = MappingProxyType(
    {
        settings.algorithm: settings
        for settings in (SACSettings, PPOSettings, TQCSettings, CloningSettings, ClonedPPOSettings)
    }
)
