# SPDX-License-Identifier: BSD-2-Clause
import pytest

import sst_pin
from sst_pin import Contact, Rope
from sst_pin.errors import InputError, UnknownNameError
from tests.gallery.touching import frame, planar


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: Contact("a", radius=-1), "negative"),
        (lambda: Contact("a", restitution=1.5), "larger than 1"),
        (lambda: Contact("a", ground="a"), "two different frames"),
        (lambda: Contact(3), "not a name"),
        (lambda: Rope("a", "b", 0), "positive length"),
        (lambda: Rope("a", "a", 1), "two different frames"),
        (lambda: Rope("a", "b", float("nan")), "not finite"),
    ],
)
def test_contacts_and_ropes_refuse_what_cannot_be(make, problem):
    with pytest.raises(InputError, match=problem):
        make()


def test_a_robot_refuses_contacts_on_one_body_twice_or_of_unknown_frames():
    model = planar(1.0, 0.1)
    frame(model, "a", "turn", (0, 0, 0))
    frame(model, "b", "turn", (0, 0, 1))
    for contacts, error in (
        ([Contact("a", ground="b")], InputError),
        ([Contact("a"), Contact("a")], InputError),
        ([Contact("c")], UnknownNameError),
        ([Rope("a", "c", 1.0)], UnknownNameError),
        (["a"], InputError),
    ):
        with pytest.raises(error):
            sst_pin.ClosedChain(model, [], [], contacts=contacts)
    elements = [Rope("universe", "a", 1.0), Contact("a"), Contact("a", ground="universe", name="x")]
    chain = sst_pin.ClosedChain(model, [], [], contacts=elements)
    assert [str(x) for x in chain.contacts] == ["a", "x", "universe-a"]
    assert chain.with_coordinates(["turn", "x", "z"]).contacts == chain.contacts
