# SPDX-License-Identifier: BSD-2-Clause
"""Names that other packages have for what a chain computes."""

import pytest

import sst_pin

NAMES = {
    "inverse_dynamics": "compute_torques",
    "forward_dynamics": "compute_accelerations",
    "mass_matrix": "reduced_terms",
    "jacobian": "frame_jacobian",
    "forward_kinematics": "frame_placement",
    "inverse_kinematics": "frame_configuration",
    "to_mjcf": "sst_pin.write_mjcf",
}


@pytest.mark.parametrize(("guess", "name"), NAMES.items())
def test_a_name_of_another_package_leads_to_ours(guess, name):
    chain = sst_pin.robots.five_bar().with_coordinates(None)
    with pytest.raises(AttributeError, match=rf"ClosedChain has no {guess}; use {name}\("):
        getattr(chain, guess)
    assert guess not in dir(chain)
    owner = sst_pin if name.startswith("sst_pin.") else chain
    assert callable(getattr(owner, name.removeprefix("sst_pin.")))


def test_an_error_in_a_property_is_not_hidden():
    class Broken(sst_pin.ClosedChain):
        @property
        def home(self):
            return self.mechanism.no_such_name

    lift = sst_pin.robots.five_bar()
    broken = Broken(lift.model, lift.closures, lift.motor_names)
    with pytest.raises(AttributeError, match="no_such_name"):
        broken.home  # noqa: B018
    assert not hasattr(broken, "foot")
