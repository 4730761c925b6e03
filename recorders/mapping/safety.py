"""Safety modes and speed scales of agents; both may come on topics of their own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from hrclog.events import SafetyStateChanged
from hrclog.recorders.mapping.facts import Fact, Notes
from hrclog.recorders.mapping.fields import number, word
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.only import Only
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table

KNOWN_MODES: Final = {
    "ur_dashboard_msgs/msg/SafetyMode": dict(
        enumerate(
            [
                "normal",
                "reduced",
                "protective_stop",
                "recovery",
                "safeguard_stop",
                "system_emergency_stop",
                "robot_emergency_stop",
                "violation",
                "fault",
                "validate_joint_id",
                "undefined",
                "automatic_mode_safeguard_stop",
                "three_position_enabling_stop",
            ],
            start=1,
        )
    ),
    "franka_msgs/msg/FrankaRobotState": dict(
        enumerate("other idle move guiding reflex user_stopped automatic_error_recovery".split())  # noqa: SIM905 - words
    ),
}
"""What the modes of known message types are called."""

_SCALES: Final = {"percent": 100.0, "fraction": 1.0}
_STEP: Final = 0.005
_ROUNDING: Final = 1e-3


class Safety(Meaning):
    """Mode, speed or both of one agent; each change is an event, repetitions are none."""

    kind = "safety"
    summary = "a safety mode, a speed scale (percent or fraction), or both, of one agent"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._agent = table.value("agent", captures=self.pattern.names)
        self._mode = table.path("mode") if "mode" in table else None
        self._modes = table.renames("modes")
        self._speed = table.path("speed") if "speed" in table else None
        self._scale = _SCALES[table.choice("unit", tuple(_SCALES), None if "speed" in table else "percent")]
        self._step = table.number("step", _STEP, above=0.0)
        self._time = table.time()
        self._only = Only(table)
        if self._mode is None and self._speed is None:
            table.problem("found neither mode nor speed, expected a field for one of them")
        self.states: dict[str, tuple[str, float | None]] = {}
        """Mode and speed of each agent; tables about one agent share them."""

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return the change that a message tells."""
        content = received.content
        if not self._only.holds(content):
            return
        agent, at = self._agent.of(content, self._captures(received)), self._time.of(received)
        if at.ns != received.time_ns:
            notes.stamp(received.time_ns, at.ns, sure=True)
        mode, speed = self.states.get(agent, ("", None))
        if self._mode is not None:
            mode = self._named(word(self._mode.of(content)), received, notes)
        if self._speed is not None:
            measured = self._fraction(self._speed.of(content))
            jumps = speed is None or (measured in (0.0, 1.0) and measured != speed)
            speed = measured if jumps or abs(measured - (speed or 0.0)) >= self._step else speed
        if self.states.get(agent) != (mode, speed):
            self.states[agent] = (mode, speed)
            yield Fact(SafetyStateChanged(time_ns=at.ns, agent=agent, mode=mode, speed_scale=speed), at.clock)

    def _named(self, mode: str, received: Received, notes: Notes) -> str:
        if self._modes is None:
            known = KNOWN_MODES.get(received.type_name, {})
            return known.get(int(mode), mode) if mode.isdigit() else mode
        if mode not in self._modes:
            notes.remark(
                "unmapped_value", f"{{}} of {received.topic}: the mode {mode!r} is not in modes of {self.where}"
            )
        return self._modes.get(mode, mode)

    def _fraction(self, value: object) -> float:
        fraction = number(value) / self._scale
        if not math.isfinite(fraction) or not -_ROUNDING <= fraction <= 1 + _ROUNDING:
            most = f"{self._scale:g}"
            raise ValueError(f"found the speed {value!r}, expected 0 to {most}, as its unit is")
        return min(max(fraction, 0.0), 1.0)
