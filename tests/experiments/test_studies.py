import pytest

import ocp_envs
from moe_policy.experiments.studies import STUDIES, Study, study_of
from moe_policy.learning import recipes
from ocp_envs.sets.splits import split_of
from tests.small_problems import DOUBLE_INTEGRATOR


@pytest.mark.parametrize("env_id", STUDIES)
def test_studies_name_what_exists(env_id):
    problem, study = ocp_envs.load(env_id), STUDIES[env_id]
    assert set(study.compared) | set(study.published) | set(study.sized) | set(study.paper_settings) <= set(
        study.models
    )
    for name in study.models:
        with pytest.raises(TypeError, match="expected a Database"):
            recipes.make(name, object())
    total = len(split_of(problem, "training"))
    assert all(size < total for size in study.sizes)
    assert set(study.short_learners) <= set(study.learners)
    assert all(settings.algorithm == name for name, settings in study.learners.items())


def test_a_problem_of_ones_own_has_a_study():
    assert study_of(DOUBLE_INTEGRATOR) == Study()
