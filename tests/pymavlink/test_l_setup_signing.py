"""A companion without a key is given one over a trusted link, as `signing setup` of MAVProxy does."""

import pathlib
import time

import pytest
from conftest import World, mavlink, patience
from test_k_signing import KEY, Signer, answers, answers_to_the_deaf, now, sign_with

ASK = mavlink.MAV_CMD_REQUEST_MESSAGE


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = pathlib.Path(tmp_path_factory.mktemp("setup"))
    world = World(
        folder,
        endpoint_keys=', signing = "require", trusted = true',
        sections='[signing]\nkey_file = "signing.key"',
    )
    yield world
    world.close()


def test_the_first_key_comes_over_a_trusted_link(world):
    assert answers_to_the_deaf(world, Signer(None).command(ASK, 148)) == [], "nobody comes in without a key"
    offer = mavlink.MAVLink_setup_signing_message(1, 1, KEY, now()).pack(Signer(None).mav)
    world.link.write(offer)
    world.link.write(offer)
    sign_with(KEY)(world.link)
    assert answers(world, Signer(KEY, 40).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert answers(world, Signer(None).command(ASK, 148)) == []
    deadline = time.monotonic() + patience(5)
    key_file = world.folder / "signing.key"
    while not key_file.exists() or key_file.read_text().strip() != KEY.hex():
        assert time.monotonic() < deadline, "the key is not written"
        world.drain(0.1)
    # Zeros ask for no signatures at all: refused, that is decided by hand.
    zeros = mavlink.MAVLink_setup_signing_message(1, 1, bytes(32), now()).pack(Signer(None).mav)
    world.link.write(zeros)
    assert answers(world, Signer(None).command(ASK, 148)) == []
    world.cut_power()
    assert answers(world, Signer(KEY, 41).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]
