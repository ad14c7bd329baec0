"""The evidence: what scripts/ runs and results/ holds. Nothing but scripts and tests imports it.

It needs packages that the library does not need. Importing it without them exits, in one line that says what to
install, so that no script fails after hours of work.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from types import MappingProxyType

#: Optional packages by the name of the module that is imported, with the extra that installs them.
PACKAGES: Mapping[str, str] = MappingProxyType(
    {
        "matplotlib": "experiments",
        "PIL": "experiments",
        "stable_baselines3": "experiments",
        "sb3_contrib": "tqc",
        "distributed": "cluster",
        "minari": "minari",
        "h5py": "minari",
    }
)


def install(module: str) -> str:
    """What to do where the optional package ``module`` is missing, in words."""
    return f'{module} is missing; install it with: pip install -c constraints.txt -e ".[{PACKAGES[module]}]"'


for _module in ("matplotlib", "PIL"):
    if find_spec(_module) is None:
        sys.exit(f"error: {install(_module)}")
