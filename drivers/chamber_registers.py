"""Reading and writing a controller's registers by name, and doing without those it lacks."""

import logging

from drivers.errors import DeviceError, LimitError
from drivers.modbus_link import ModbusLink, RefusalError
from drivers.registers import Register, load_map
from drivers.station import ChamberConfig

log = logging.getLogger(__name__)


class ControllerRegisters:
    """A controller's registers by name; everything written is read back.

    Not every build has every register. One that its map calls optional is left out, and that is
    logged, when the controller refuses it twice running without ever having answered for it.

    Parameters
    ----------
    config : ChamberConfig
        Model, link and scaling.
    name : str
        The instrument's name, for messages.

    Raises
    ------
    ValueError
        If the URL cannot be understood or there is no map of the model.
    """

    def __init__(self, config: ChamberConfig, *, name: str) -> None:
        self._map = load_map(config.model)
        self._config = config
        self._name = name
        self._link = ModbusLink(config, name=name, barrier=self._map.barrier)
        self._fitted: dict[str, bool] = {}  # as far as is known

    def _get(self, name: str) -> float:
        register = self._map[name]
        words = self._link.read(register.address, register.count, what=name)
        self._fitted[name] = True
        return register.decode(words, self._config.decimals)

    def _get_optional(self, name: str) -> float | None:
        """Read a register that not every controller has; None when it has not."""
        if self._fitted.get(name) is False:
            return None
        try:
            return self._get(name)
        except RefusalError as refusal:
            if not (refusal.absent and self._map[name].optional and name not in self._fitted):
                raise
        try:  # a single refusal may be a mishap, and what is left out is not asked for again
            return self._get(name)
        except RefusalError as refusal:
            if not refusal.absent:
                raise
            log.warning("%s; doing without", refusal)
            self._fitted[name] = False
            return None

    def _forget_missing(self) -> None:
        """Ask anew for registers that were found missing."""
        self._fitted = {name: True for name, fitted in self._fitted.items() if fitted}

    def _state(self, name: str) -> str:
        """Read an enumerated register by name."""
        return self._map[name].name_of(self._get(name))

    def _set(self, name: str, value: float | str) -> str:
        """Write a register and compare what it then holds; return what was read back."""
        register = self._map[name]
        number = float(register.values[value]) if isinstance(value, str) else value
        if self._fitted.get(name) is False:
            return f"no {name} here"
        try:
            self._link.write(register.address, self._encode(name, number), what=name)
        except RefusalError as refusal:
            if not (refusal.absent and register.optional):
                raise
            back = self._get_optional(name)
            if back is None:
                return f"no {name} here"
            if not self._same(register, back, number):  # it is there, and cannot be written
                raise
        else:
            back = self._get(name)
        if not self._same(register, back, number):
            raise DeviceError(
                f"{self._name}: wrote {name} = {self._text(register, number)}, "
                f"read back {self._text(register, back)}"
            )
        return f"{name} = {self._text(register, back)}"

    def _command(self, name: str, value: str, *, repeatable: bool) -> None:
        """Write a register that acts and holds nothing to read back."""
        register = self._map[name]
        words = self._encode(name, register.values[value])
        self._link.write(register.address, words, what=f"{name} {value}", repeatable=repeatable)

    def _encode(self, name: str, number: float) -> tuple[int, ...]:
        try:
            return self._map[name].encode(number, self._config.decimals)
        except ValueError as error:
            raise LimitError(f"{self._name}: {name}: {error}, nothing was sent") from None

    def _same(self, register: Register, back: float, number: float) -> bool:
        return abs(back - number) <= register.tolerance(self._config.decimals)

    @staticmethod
    def _text(register: Register, number: float) -> str:
        return register.name_of(number) if register.values else f"{number:g}"
