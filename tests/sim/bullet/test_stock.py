"""Objects and slots: who has a claim on what."""

from __future__ import annotations

from cells import HUMAN, ROBOT, small_cell
from hypothesis import given
from hypothesis import strategies as st

from hrclog.sim.bullet.stock import Stock
from hrclog.sim.cell.description import Slot

CELL = small_cell()
AGENTS = (ROBOT, HUMAN)


def names(stock: Stock, agent: str, group: str = "blue") -> list[str]:
    """Return the names of what an agent may take."""
    return [item.box.name for item in stock.available(group, agent)]


def slots(stock: Stock, agent: str) -> list[str]:
    """Return the names of the slots that an agent may fill."""
    return [slot.name for slot in stock.free_slots("bin", agent)]


def test_at_first_everybody_may_take_everything() -> None:
    stock = Stock(CELL)
    for agent in AGENTS:
        assert names(stock, agent) == ["blue_1", "blue_2", "blue_3"]
        assert slots(stock, agent) == [f"bin_{number}" for number in range(1, 7)]
        assert stock.held_by(agent) is None


def test_a_claimed_object_is_left_to_its_agent_until_it_is_given_up() -> None:
    stock = Stock(CELL)
    stock.claim("blue_2", ROBOT)
    assert names(stock, HUMAN) == ["blue_1", "blue_3"]
    assert "blue_2" in names(stock, ROBOT)
    assert stock.held_by(ROBOT) is None
    stock.give_up("blue_2")
    assert "blue_2" in names(stock, HUMAN)


def test_a_claimed_slot_is_left_to_its_agent_until_it_is_given_up() -> None:
    stock = Stock(CELL)
    stock.claim("bin_1", ROBOT)
    assert "bin_1" not in slots(stock, HUMAN)
    assert "bin_1" in slots(stock, ROBOT)
    stock.give_up("bin_1")
    assert "bin_1" in slots(stock, HUMAN)


def test_an_object_in_a_hand_stays_there_when_the_claim_is_given_up() -> None:
    stock = Stock(CELL)
    stock.claim("blue_2", ROBOT)
    stock.take("blue_2")
    stock.give_up("blue_2")
    held = stock.held_by(ROBOT)
    assert held is not None
    assert held.box.name == "blue_2"
    assert "blue_2" not in names(stock, HUMAN)


def put_down(stock: Stock, agent: str, name: str, slot: Slot) -> None:
    """Let an agent take an object to a slot."""
    stock.claim(name, agent)
    stock.take(name)
    stock.claim(slot.name, agent)
    held = stock.held_by(agent)
    assert held is not None
    stock.put(held, slot.name)


def test_what_is_placed_stands_in_its_slot_for_good() -> None:
    stock, slot = Stock(CELL), CELL.slots[0]
    put_down(stock, ROBOT, "blue_2", slot)
    assert stock.held_by(ROBOT) is None
    assert stock.items["blue_2"].position == slot.position
    for agent in AGENTS:
        assert names(stock, agent) == ["blue_1", "blue_3"]
        assert slot.name not in slots(stock, agent)


def test_a_slot_that_holds_an_object_stays_taken_when_the_claim_on_it_is_given_up() -> None:
    stock, slot = Stock(CELL), CELL.slots[0]
    put_down(stock, ROBOT, "blue_2", slot)
    stock.give_up(slot.name)
    assert slot.name not in slots(stock, ROBOT)


def test_what_stands_in_a_slot_can_be_taken_from_there_again() -> None:
    stock, (first, second) = Stock(CELL), CELL.slots[:2]
    put_down(stock, ROBOT, "blue_2", first)
    assert names(stock, HUMAN, "bin") == ["blue_2"]
    stock.claim("blue_2", HUMAN)
    stock.take("blue_2")
    assert names(stock, ROBOT, "bin") == []
    assert first.name in slots(stock, ROBOT)
    held = stock.held_by(HUMAN)
    assert held is not None
    stock.claim(second.name, HUMAN)
    stock.put(held, second.name)
    assert held.position == second.position
    assert first.name in slots(stock, ROBOT)
    assert second.name not in slots(stock, ROBOT)


def test_an_object_that_was_put_down_is_taken_even_if_its_slot_was_given_up() -> None:
    stock, slot = Stock(CELL), CELL.slots[0]
    put_down(stock, ROBOT, "blue_2", slot)
    stock.give_up(slot.name)
    stock.claim("blue_2", HUMAN)
    stock.take("blue_2")
    assert slot.name in slots(stock, ROBOT)


def test_giving_up_what_nobody_claims_changes_nothing() -> None:
    stock = Stock(CELL)
    for name in ("blue_1", "bin_1", "no such thing"):
        stock.give_up(name)
    assert names(stock, ROBOT) == ["blue_1", "blue_2", "blue_3"]
    assert len(slots(stock, ROBOT)) == 6


def test_stocks_of_one_cell_are_apart() -> None:
    one, other = Stock(CELL), Stock(CELL)
    put_down(one, ROBOT, "blue_1", CELL.slots[0])
    assert names(other, HUMAN) == ["blue_1", "blue_2", "blue_3"]
    assert len(slots(other, HUMAN)) == 6


@given(st.lists(st.tuples(st.sampled_from(AGENTS), st.integers(0, 5), st.sampled_from(["go", "leave", "take", "put"]))))
def test_nothing_is_in_two_hands_and_no_slot_holds_two_objects(deeds: list[tuple[str, int, str]]) -> None:
    stock = Stock(CELL)
    heading: dict[str, str] = {}
    for agent, chance, deed in deeds:
        held = stock.held_by(agent)
        if held is None and deed == "go" and (found := names(stock, agent)):
            if agent in heading:
                stock.give_up(heading.pop(agent))
            heading[agent] = found[chance % len(found)]
            stock.claim(heading[agent], agent)
        elif held is None and deed == "leave" and agent in heading:
            stock.give_up(heading.pop(agent))
        elif held is None and deed == "take" and agent in heading:
            stock.take(heading.pop(agent))
        elif held is not None and deed == "put" and (free := stock.free_slots("bin", agent)):
            slot = free[chance % len(free)]
            stock.claim(slot.name, agent)
            stock.put(held, slot.name)
        items = list(stock.items.values())
        for one in AGENTS:
            assert sum(item.held and item.agent == one for item in items) <= 1
        placed = [item.position for item in items if item.slot is not None and not item.held]
        assert len(set(placed)) == len(placed)
        for one, name in heading.items():
            assert stock.items[name].agent == one
