import dataclasses

import pytest

from ocp_envs.data.settings import GenerationSettings
from tests.data.running import SMALL


def test_databases_made_before_the_kind_of_guess_was_a_setting_are_the_same_as_its_default():
    assert set(SMALL.record()) == {f.name for f in dataclasses.fields(SMALL)} - {"guess", "fit"}
    assert dataclasses.replace(SMALL, guess="line").record() == {**SMALL.record(), "guess": "line"}
    assert dataclasses.replace(SMALL, fit=9).record() == {**SMALL.record(), "fit": 9}


@pytest.mark.parametrize(
    "change",
    [{"first": 0}, {"chunk": 0}, {"starts": 0}, {"neighbours": 0}, {"cold": -1}, {"margin": -1.0}, {"guess": "wild"}],
)
def test_settings_are_checked(change):
    with pytest.raises(ValueError, match=rf"{next(iter(change))}( must be|: expected) "):
        GenerationSettings(**change)
