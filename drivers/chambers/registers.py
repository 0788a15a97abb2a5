"""Reading and writing a controller's registers by name, and doing without those it lacks."""

import logging
from collections.abc import Callable, Mapping

from drivers.chambers.maps import Register, load_map
from drivers.errors import DeviceError, LimitError, RecognitionError
from drivers.links.modbus_link import ModbusLink, RefusalError
from drivers.station import ChamberConfig

log = logging.getLogger(__name__)


class ControllerRegisters:
    """A controller's registers by name; everything written is read back.

    Nothing leaves before there is evidence of which controller it is: the link asks `_allow_write`
    before every question that writes.

    Not every build has every register. One that its map calls optional is left out, and that is
    logged, when the controller refuses it twice running without ever having answered for it.

    Parameters
    ----------
    config : ChamberConfig
        Model, link and scaling.
    name : str
        The instrument's name, for messages.
    permit : callable, optional
        Called right before every write; what it raises keeps it from being sent.

    Raises
    ------
    ValueError
        If the URL cannot be understood or there is no map of the model.
    """

    def __init__(
        self, config: ChamberConfig, *, name: str, permit: Callable[[], None] | None = None
    ) -> None:
        self._map = load_map(config.model, config.word_order)
        self._config = config
        self._name = name
        self._permit = permit
        self._evidence: Mapping[str, float | str] = {}  # what the controller was recognised by
        self._link = ModbusLink(
            config, name=name, barrier=self._map.barrier, before_write=self._allow_write
        )
        self._fitted: dict[str, bool] = {}  # as far as is known
        self._commanded: dict[str, float] = {}  # what watched registers held once written

    def _require_recognition(self) -> None:
        if not self._evidence:
            raise RecognitionError(
                f"{self._name}: the controller was not recognised, nothing was sent; "
                "`identify` comes first"
            )

    def _allow_write(self) -> None:
        self._require_recognition()
        if self._permit is not None:
            self._permit()

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
        self._commanded.pop(name, None)  # until it is known whether it was taken
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
        if register.watched:
            self._commanded[name] = back
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
