"""Optimal control, nearest neighbour, networks, mixtures, reinforcement learning and the bare stabiliser on the same starts.

With no argument the shipped models run on the shipped validation set, which takes about a minute. ``--train`` first makes
everything anew under ``data/``: training, development and validation sets, planners, and SAC at a small budget. The table
goes to the terminal, and with all figures to ``results/compare_<env>.json`` and ``.png``.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import moe_policy
import ocp_envs
from moe_policy import baselines, recipes
from moe_policy.comparison import COLUMNS, Contestant, compare
from moe_policy.reporting import comparison_figure, text_table
from ocp_envs.records import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
PLANNERS = {"PendulumSwingup-v0": ("nearest", "snn", "moe-custom", "moe-kmeans-4")}
