import os
import struct

import numpy as np
import pytest

from ocp_envs.solvers.channel import Channel, Gone, Silent


@pytest.fixture
def ends():
    """A channel to itself, and the descriptor it writes to."""
    source, sink = os.pipe()
    yield Channel(source, sink), sink
    for descriptor in (source, sink):
        try:
            os.close(descriptor)
        except OSError:
            continue  # closed by the test


def test_messages_arrive_whole_and_in_order(ends):
    channel, _ = ends
    sent = [np.arange(500.0), {"status": 1}]
    for message in sent:
        channel.send(message)
    np.testing.assert_array_equal(channel.receive(), sent[0])
    assert channel.receive(1.0) == sent[1]


def test_a_message_that_does_not_arrive_in_time_is_silence(ends):
    channel, sink = ends
    with pytest.raises(Silent):
        channel.receive(0.01)
    os.write(sink, struct.pack("<Q", 100) + b"the beginning of a message")
    with pytest.raises(Silent):
        channel.receive(0.01)


def test_a_closed_end_is_noticed_by_reader_and_writer(ends):
    channel, sink = ends
    os.close(sink)
    with pytest.raises(Gone):
        channel.receive()
    with pytest.raises(Gone):
        channel.send("nobody hears this")
