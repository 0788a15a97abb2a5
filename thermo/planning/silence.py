"""Longest silence of a test's controller while everything is in order.

The control thread beats between any two calls of an instrument, in every slice of a wait and
before every write to the chamber. So the longest time between two beats is the longest single call,
or the longest the store may take. Everything here is in real seconds.
"""

from drivers.digitisers.keysight_34970a import AUTOZERO, LINE_PERIOD_S, REPLY_BYTES, SETTLE_S
from drivers.links.modbus import parse_modbus_url
from drivers.station import StationConfig

# questions between two beats while the chamber is recognised, looked at or made safe: the
# longest such call reads about as many registers and writes none
CHAMBER_QUESTIONS = 12
# of a time limit each, for one attempt at a question: connect, and twice the limit for an answer
# that trickles in
TCP_LIMITS = 3
# the same on a serial line, and the line to fall quiet and answer a question that brings it in step
RTU_LIMITS = 6
# open, empty, fence, answer, error queue: one attempt on a line of text
SERIAL_LIMITS = 5
HEAD_QUESTIONS = 4  # a move: position, command, errors, position again


# all in real seconds
READ_PATIENCE_S = 10.0  # for a reading back; as long as between two looks at a waiting chamber


def longest_step_s(config: StationConfig, store_s: float = READ_PATIENCE_S) -> float:
    """Return the longest time that may pass between two beats while everything is in order.

    Every question may need all its attempts, each as long as it is allowed to be.

    Parameters
    ----------
    config : StationConfig
        Its time-outs and retries count.
    store_s : float
        The longest the store may take for one entry, real s.

    Returns
    -------
    float
        Real seconds.
    """
    chamber, digitiser, head = config.chamber, config.digitiser, config.head
    try:
        tcp = parse_modbus_url(chamber.url).transport == "tcp"
    except ValueError:  # told when the chamber is opened
        tcp = True
    limits = TCP_LIMITS if tcp else RTU_LIMITS
    chamber_s = CHAMBER_QUESTIONS * (chamber.retries + 1) * limits * chamber.timeout_s
    channel_s = AUTOZERO * digitiser.nplc * LINE_PERIOD_S + SETTLE_S
    channel_s += 10.0 * REPLY_BYTES / digitiser.baud
    channels_s = 2 * len(config.inputs) * channel_s  # an output and a thermistor each
    scan_s = (digitiser.retries + 1) * (SERIAL_LIMITS * digitiser.timeout_s + channels_s)
    head_s = HEAD_QUESTIONS * (head.retries + 1) * SERIAL_LIMITS * head.timeout_s
    return max(chamber_s, scan_s, head_s, store_s)


def silence_limit_s(config: StationConfig) -> float:
    """Return how long the controller may be silent before the guardian takes over, real s."""
    return longest_step_s(config) + config.guardian.margin_s
