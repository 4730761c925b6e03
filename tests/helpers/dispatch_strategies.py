"""Plans, scripts and policies by hypothesis, misbehaving agents included."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import strategies as st

from hrclog.events import Outcome
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.plan import Arrival, Plan, PlanItem
from hrclog.recorders.dispatch.policy import DispatchPolicy, OnFailure
from hrclog.recorders.executors.scripted import Misbehaviour, ScriptStep

FACTS = ("part", "door")


@st.composite
def plans(draw: st.DrawFn, *, meets: bool = False, fewest: int = 0) -> Plan:
    """Draw plans of 1-3 agents, row by row, so that precedences never point to a later row."""
    items: list[PlanItem] = []
    agents = [f"a{n}" for n in range(draw(st.integers(2 if meets else 1, 3)))]
    lengths = {agent: draw(st.integers(max(fewest, 1), 4)) for agent in agents}
    for row in range(4):
        label = f"m{row}" if meets and draw(st.booleans()) else ""
        for agent in (agent for agent in agents if row < lengths[agent]):
            earlier = [item.item_id for item in items]
            after = draw(st.sets(st.sampled_from(earlier), max_size=2)) if earlier and draw(st.booleans()) else ()
            needs = draw(st.sets(st.sampled_from(FACTS))) if draw(st.integers(0, 4)) == 0 else ()
            start = draw(st.none() | st.floats(0.0, 9.0))
            name = f"{agent}-{row}"
            items.append(
                PlanItem(name, agent, f"t{name}", tuple(sorted(after)), start, None, label, tuple(sorted(needs)))
            )
    met = [item.meet for item in items]
    items = [replace(item, meet=item.meet if met.count(item.meet) > 1 else "") for item in items]
    arrivals = tuple(Arrival(fact, draw(st.floats(0.0, 9.0))) for fact in FACTS if draw(st.booleans()))
    return Plan("drawn", tuple(items), arrivals)


@st.composite
def scripts(draw: st.DrawFn, plan: Plan) -> list[ScriptStep]:
    """Draw one or two steps for each item, misbehaviour included; some items have none at all."""
    steps = []
    seconds = st.sampled_from((0.0, 0.5, 1.0, 2.5, 7.0))
    for item in plan.items:
        for _ in range(draw(st.sampled_from((0, 1, 1, 1, 2)))):
            outcome = draw(st.sampled_from((Outcome.SUCCEEDED,) * 4 + tuple(Outcome)))
            odd = draw(st.sampled_from(("",) * 9 + tuple(Misbehaviour)))
            steps.append(
                ScriptStep(
                    agent=item.agent,
                    task=item.task,
                    delay_s=draw(seconds),
                    duration_s=draw(seconds),
                    outcome=outcome,
                    misbehaviour=odd,
                )
            )
    return steps


policies = st.builds(
    DispatchPolicy,
    mode=st.sampled_from(DispatchMode),
    max_attempts=st.integers(1, 3),
    on_failure=st.sampled_from(OnFailure),
    timeout_s=st.sampled_from((None, 1.5, 5.0)),
    start_timeout_s=st.sampled_from((None, 0.25)),
    grace_s=st.sampled_from((0.0, 1.0)),
    max_wait_s=st.sampled_from((None, 0.0, 3.0)),
)
