"""Where each object is, which agent claims it, and which slots are free."""

from __future__ import annotations

from dataclasses import dataclass

from hrclog.sim.cell.description import Box, Cell, Point, Slot


@dataclass(slots=True)
class Item:
    """An object and where it is; `agent` holds it, or is on its way to it; `slot` is where it was put.

    Position in m, yaw in rad.
    """

    box: Box
    position: Point
    agent: str = ""
    held: bool = False
    yaw: float = 0.0
    slot: Slot | None = None

    @property
    def group(self) -> str:
        """What it is picked from: its own group at first, that of its slot once it was put somewhere."""
        return self.slot.group if self.slot else self.box.group


class Stock:
    """The objects and slots of a cell.

    Args:
        cell: where everything is at first.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.items = {box.name: Item(box, box.position) for box in cell.objects}
        self._slots = {slot.name: slot for slot in cell.slots}
        self._slot_agents: dict[str, str] = {}  # agent by slot, "" where an object stands in it

    def available(self, group: str, agent: str) -> list[Item]:
        """Return the objects of a group that an agent may take: in no hand, and not claimed by another."""
        items = (item for item in self.items.values() if item.group == group and not item.held)
        return [item for item in items if item.agent in ("", agent)]

    def free_slots(self, group: str, agent: str) -> list[Slot]:
        """Return the slots of a group that are empty and not claimed by another agent."""
        return [slot for slot in self._cell.slots_of(group) if self._slot_agents.get(slot.name, agent) == agent]

    def held_by(self, agent: str) -> Item | None:
        """Return what an agent has in its hand."""
        return next((item for item in self.items.values() if item.held and item.agent == agent), None)

    def claim(self, name: str, agent: str) -> None:
        """Keep an object or a slot for an agent."""
        if name in self.items:
            self.items[name].agent = agent
        else:
            self._slot_agents[name] = agent

    def give_up(self, name: str) -> None:
        """Drop the claim on an object or a slot; what is in a hand stays there."""
        if name in self.items:
            if not self.items[name].held:
                self.items[name].agent = ""
        elif self._slot_agents.get(name):  # "" is an object that stands there, and stays
            del self._slot_agents[name]

    def take(self, name: str) -> None:
        """Let the agent that claims an object hold it; the slot it stood in is free again."""
        item = self.items[name]
        item.held = True
        if item.slot is not None:
            del self._slot_agents[item.slot.name]

    def put(self, item: Item, slot: str) -> None:
        """Let an object stand in a slot."""
        item.held, item.agent, item.slot = False, "", self._slots[slot]
        item.position = item.slot.position
        self._slot_agents[slot] = ""
