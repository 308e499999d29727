"""Frames of both protocols: as the vendors' SDKs write them, and whole or not at all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.robot.protocols import DYNAMIXEL, FEETECH, PROTOCOLS, Packet, Register

BOTH = pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)
TRICKY = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55, 0x7A]), max_size=24).map(bytes)


def test_frames_are_those_of_the_manuals():
    """Feetech's ping of servo 1; Robotis' ping of servo 1 and their example of a read."""
    assert FEETECH.instruction(1, 0x01).hex(" ") == "ff ff 01 02 01 fb"
    assert DYNAMIXEL.instruction(1, 0x01).hex(" ") == "ff ff fd 00 01 03 00 01 19 4e"
    read = DYNAMIXEL.instruction(1, 0x02, DYNAMIXEL.place(132, 4))
    assert read.hex(" ") == "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"


@BOTH
@given(before=TRICKY, content=TRICKY, servo=st.integers(0, 252), cut=st.integers(0, 60))
def test_a_packet_is_found_after_anything_and_however_it_arrives(
    protocol, before, content, servo, cut
):
    noise = before.replace(b"\xff", b"\x00")  # what looks like a header may hide what follows it
    sent = noise + protocol.answer(servo, 0, content)
    buffer, found = bytearray(), []
    for part in (sent[:cut], sent[cut:]):
        buffer += part
        while (packet := protocol.take(buffer, answers=True)) is not None:
            found.append(packet)
    assert found == [Packet(servo, 0, content)]
    assert not protocol.take(buffer, answers=True)
    instruction = bytearray(protocol.instruction(servo, 0x03, content))
    assert protocol.take(instruction, answers=False) == Packet(servo, 0x03, content)


def test_instructions_and_answers_of_dynamixels_are_not_taken_for_each_other():
    both = DYNAMIXEL.instruction(7, 0x02, b"\x84") + DYNAMIXEL.answer(7, 0, b"\x01")
    assert DYNAMIXEL.take(bytearray(both), answers=True) == Packet(7, 0, b"\x01")
    assert DYNAMIXEL.take(bytearray(both), answers=False) == Packet(7, 0x02, b"\x84")
    assert DYNAMIXEL.take(bytearray(DYNAMIXEL.answer(7, 0)), answers=False) is None


@pytest.mark.parametrize("servo", [1, 4, 200])
def test_a_byte_255_before_a_packet_is_no_part_of_its_header(servo):
    sent = bytearray(b"\xff" + FEETECH.answer(servo, 0, b"\x01\x02"))
    assert FEETECH.take(sent, answers=True) == Packet(servo, 0, b"\x01\x02")


@BOTH
@given(place=st.integers(0, 200), bit=st.integers(0, 7))
def test_a_packet_with_a_wrong_bit_is_never_taken_for_what_was_sent(protocol, place, bit):
    frame = bytearray(protocol.answer(3, 0, bytes(range(8))))
    frame[place % len(frame)] ^= 1 << bit
    assert protocol.take(frame, answers=True) != Packet(3, 0, bytes(range(8)))


@pytest.mark.parametrize("sign", [-1, 15, 10])
@given(value=st.integers(-1023, 1023))
def test_numbers_with_a_sign_come_back(sign, value):
    register = Register(0, 2, sign)
    assert register.decode(register.encode(value)) == value


def test_what_does_not_fit_is_cut_and_never_wraps():
    assert Register(0, 1).decode(Register(0, 1).encode(300)) == 255
    assert Register(0, 2).decode(Register(0, 2).encode(-5)) == 0
    assert Register(0, 2, 15).decode(Register(0, 2, 15).encode(-40000)) == -32767
    assert Register(0, 2, -1).decode(Register(0, 2, -1).encode(40000)) == 32767
