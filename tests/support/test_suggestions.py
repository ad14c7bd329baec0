from ocp_envs.support.suggestions import did_you_mean


def test_the_nearest_name_is_suggested():
    assert did_you_mean("pendulum", ["PendulumSwingup-v0", "GroundVehicle-v0"]) == "did you mean 'PendulumSwingup-v0'? "
    assert did_you_mean("params", ("parameters", "extrapolate")) == "did you mean 'parameters'? "


def test_nothing_is_suggested_where_nothing_is_near():
    assert did_you_mean("xyz", ["boundary"]) == ""
    assert did_you_mean(7, []) == ""
