"""Errors between the workbench and an instrument.

::

    InstrumentError
    ├── LimitError       a set point outside the injected limits; nothing was sent
    ├── LinkError        no usable answer: silence, a lost connection; the link was dropped
    ├── ProtocolError    an answer that is not the answer to the question; the link was dropped
    ├── FencedError      somebody else has taken the instrument over; nothing was sent
    └── DeviceError      a well-formed answer that says no: exception code, error, sensor break
        └── RecognitionError   not shown to be the instrument of the station file; nothing was sent
"""


class InstrumentError(Exception):
    """Base of all; the message is one line: what, where, what was expected."""


class LimitError(InstrumentError):
    """A set point outside the limits was refused before a byte was sent."""


class LinkError(InstrumentError):
    """The instrument did not answer in time or the connection is gone."""


class ProtocolError(InstrumentError):
    """The bytes that came back are not an answer to what was asked."""


class DeviceError(InstrumentError):
    """The instrument answered, and the answer is a refusal or a fault of its own."""


class RecognitionError(DeviceError):
    """The instrument was not shown to be that of the station file; nothing is written to it."""


class FencedError(InstrumentError):
    """The right to command the instrument was taken away; nothing was sent."""
