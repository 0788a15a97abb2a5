"""What can go wrong between the workbench and an instrument.

::

    InstrumentError
    ├── LimitError       a set point outside the injected limits; nothing was sent
    ├── LinkError        no usable answer: silence, a lost connection; the link was dropped
    ├── ProtocolError    an answer that is not the answer to the question; the link was dropped
    └── DeviceError      a well-formed answer that says no: exception code, error, sensor break
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
