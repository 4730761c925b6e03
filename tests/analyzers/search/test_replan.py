"""The rest of runs planned anew: what is over or under way stays, and in the end all work is done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from sizes import many
from sure_times import sure_times

from hrclog.analyzers.search import replan
from hrclog.analyzers.search.judge import Objective
from hrclog.analyzers.search.replan import plan_rest, replanner, rest_of
from hrclog.errors import ScenarioError
from hrclog.events import AnnotationAdded, Outcome, PlanChanged, TaskEnded, TaskStarted
from hrclog.knowledge.task_times import Gap, TaskTime, TaskTimes
from hrclog.planning.plan import Arrival, Plan, PlanItem, check_plan, make_plan
from hrclog.planning.problem import Count, Precedence, Problem, Task
from hrclog.planning.random_plans import random_plans
from hrclog.planning.run_state import Running, RunState, run_state
from hrclog.sim.run import Run, carry_out, fitting_plan, policy_of
from hrclog.sim.scenario import Scenario, load_scenario

FAILING = 0.12


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let another plan be taken whatever it gains."""
    monkeypatch.setattr(replan, "LEAST_GAIN_S", -1e9)


def prone(scenario: Scenario) -> Scenario:
    """Return a scenario in which every task fails now and then."""
    return replace(scenario, works=tuple(replace(work, failure_probability=FAILING) for work in scenario.works))


def runs(scenario: Scenario, count: int, seed: int = 3) -> Iterator[Run]:
    """Yield runs of different plans in which what fails is given up, and the rest goes on."""
    policy = replace(policy_of(scenario), max_attempts=1, on_failure="skip")
    for index, plan in zip(range(count), random_plans(scenario.problem, seed), strict=False):
        yield carry_out(scenario, fitting_plan(scenario, plan), seed, index, policy)


def check_rest(problem: Problem, state: RunState, plan: Plan) -> None:
    """Raise if a plan forgets what is over, or interrupts what is under way."""
    check_plan(problem, plan)
    before = {item.item_id: item for item in state.plan.items}
    follower = {p.before: p.after for p in problem.precedences if p.kind == "next"}
    for agent in problem.agents:
        queue = plan.queue(agent)
        ids = [item.item_id for item in queue]
        done = [i for i in state.plan.queue(agent) if state.outcomes.get(i.item_id) == Outcome.SUCCEEDED]
        kept = [item for item in done if item.item_id in ids]
        assert ids[: len(kept)] == [item.item_id for item in kept]
        assert all(item.task in follower for item in done if item not in kept)  # a chain that was left is done again
        for item in queue:
            if item.item_id in before:
                known = before[item.item_id]
                assert (item.agent, item.task, item.timeout_s) == (known.agent, known.task, known.timeout_s)
            assert state.outcomes.get(item.item_id) in (None, Outcome.SUCCEEDED)
        begun = kept
        if agent in state.running:
            assert ids[len(kept)] == state.running[agent].item_id
            begun = [*kept, before[state.running[agent].item_id]]
        if begun and begun[-1].task in follower:
            assert queue[len(begun)].task == follower[begun[-1].task]
    done_of = Counter(
        before[name].task for name, end in state.outcomes.items() if end == Outcome.SUCCEEDED if name in before
    )
    chained = {*follower, *follower.values()}
    for task, count in done_of.items():
        planned = [item for item in plan.items if item.task == task and item.item_id not in state.outcomes]
        assert task in chained or len(planned) == problem.total(task) - count


def check_times(state: RunState, plan: Plan) -> None:
    """Raise if what is still to come is planned for the past, or an agent is planned to do two things at a time."""
    for agent in plan.agents():
        left = [item for item in plan.queue(agent) if item.item_id not in state.outcomes]
        ends = [item.planned_end_s or 0.0 for item in left]
        starts = [item.planned_start_s or 0.0 for item in left]
        assert all(end > state.now_s for end in ends)
        assert all(begin >= end - 1e-9 for begin, end in zip(starts[1:], ends, strict=False))
        if left and agent in state.running and state.running[agent].since_s is not None:
            since_s = state.running[agent].since_s
            assert since_s is not None
            assert starts[0] == pytest.approx(state.now_s - since_s)


def check_states(scenario: Scenario, count: int, every: int, first: int = 2) -> int:
    """Plan the rest from states of simulated runs, and return of how many."""
    times = sure_times(scenario)
    tried = 0
    for run in runs(scenario, count):
        for place in range(first, len(run.events), every):
            state = run_state(run.events[:place])
            found = plan_rest(scenario.problem, times, state)
            assert found is not None
            plan, told = found
            check_rest(scenario.problem, state, plan)
            check_times(state, plan)
            assert told.mean_s > state.now_s - 1e-9
            assert told.items.keys() == {item.item_id for item in plan.items} - state.outcomes.keys()
            tried += 1
    return tried


@pytest.mark.usefixtures("eager")
@pytest.mark.parametrize("name", ["paper", "failures", "kitting"])
def test_a_rest_keeps_what_is_over_or_under_way_and_solves_the_problem(name: str) -> None:
    assert check_states(prone(load_scenario(name)), 2, 8) > 6


@pytest.mark.slow
@pytest.mark.usefixtures("eager")
@pytest.mark.parametrize("name", ["paper", "failures", "kitting", "three-agents", "machine-tending"])
def test_a_run_can_be_planned_anew_from_every_event(name: str) -> None:
    linked = name in ("three-agents", "machine-tending")
    n_runs, step = (many(2, fuzz=5), many(9, fuzz=5)) if linked else (many(2, fuzz=5), 1)
    assert check_states(prone(load_scenario(name)), n_runs, step) > many(10, fuzz=50)


@pytest.mark.slow
@pytest.mark.usefixtures("eager")
def test_the_paper_s_cell_goes_on_from_any_state_of_its_runs() -> None:
    runs = many(2, fuzz=5)
    assert check_states(load_scenario("paper"), runs, 1) > runs * 48


@pytest.mark.slow
@pytest.mark.parametrize("name", ["failures", "machine-tending", "three-agents"])
def test_runs_that_are_planned_anew_end_with_all_work_done(name: str) -> None:
    scenario = prone(load_scenario(name))
    times = sure_times(scenario)
    policy = replace(
        policy_of(scenario),
        max_attempts=1,
        on_failure="skip",
        replan_on=("failure", "delay"),
        delay_s=4.0,
        max_replans=60,
    )
    changes = 0
    for index, plan in zip(range(many(2, fuzz=4)), random_plans(scenario.problem, 2), strict=False):
        timed = fitting_plan(scenario, plan)
        run = carry_out(scenario, timed, 2, index, policy, replan=replanner(scenario.problem, times))
        changed = [event for event in run.events if isinstance(event, PlanChanged)]
        changes += len(changed)
        assert not run.stuck
        assert not [e for e in run.events if isinstance(e, AnnotationAdded) and "going on as before" in e.reason]
        done = Counter(e.task for e in run.events if isinstance(e, TaskEnded) and e.outcome == Outcome.SUCCEEDED)
        short = {t.name for t in scenario.problem.tasks if done[t.name] < scenario.problem.total(t.name)}
        assert not short or len(changed) == policy.max_replans
        assert (run.events[-1].outcome == Outcome.SUCCEEDED) == (not short)  # type: ignore[union-attr] - the run's end
    assert changes > many(2, fuzz=4)


# a cell small enough to know what is best

TASKS = (Task("pick", ("A",)), Task("place", ("A",)), Task("long", ("A", "B")), Task("short", ("A", "B")))
PROBLEM = Problem(
    ("A", "B"),
    TASKS,
    (Count("pick", 2), Count("place", 2), Count("long", 1), Count("short", 2)),
    (Precedence("pick", "place"),),
)
SECONDS = {"pick": 2.0, "place": 3.0, "long": 10.0, "short": 4.0}


def known(sigma: float = 0.05) -> TaskTimes:
    times = {
        key: TaskTime(*key, float(np.log(SECONDS[key[1]])), sigma, 50, covariance=np.zeros((2, 2)))
        for key in PROBLEM.agent_tasks()
    }
    return TaskTimes(times, {agent: Gap(agent, 0.1, 0.0, 50) for agent in PROBLEM.agents})


ORDERS = {"A": ("pick", "place", "pick", "place"), "B": ("long", "short", "short")}


def state_of(
    plan: Plan, now_s: float, outcomes: dict[str, str], running: dict[str, Running], facts: tuple[str, ...] = ()
) -> RunState:
    return RunState(now_s, plan, outcomes, running, frozenset(facts))


def timed(plan: Plan) -> Plan:
    ends: Counter[str] = Counter()
    items = []
    for item in plan.items:
        start = ends[item.agent]
        ends[item.agent] = start + int(SECONDS[item.task])
        items.append(replace(item, planned_start_s=float(start), planned_end_s=float(ends[item.agent])))
    return replace(plan, items=tuple(items))


def test_a_run_that_goes_as_well_as_it_can_keeps_its_plan() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    state = state_of(plan, 0.5, {}, {"A": Running("A-01", 0.5), "B": Running("B-01", 0.5)})
    better = {"A": ("pick", "place", "pick", "place", "short"), "B": ("long", "short")}
    found = plan_rest(PROBLEM, known(), state)
    assert found is not None
    assert {agent: Counter(tasks) for agent, tasks in found[0].orders().items()} == {
        agent: Counter(tasks) for agent, tasks in better.items()
    }
    again = state_of(found[0], 0.5, {}, dict(state.running))
    assert plan_rest(PROBLEM, known(), again) is None
    assert replanner(PROBLEM, known())(again, "why not") is None


def test_a_run_that_is_over_is_not_planned_any_further() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    state = state_of(plan, 30.0, {item.item_id: Outcome.SUCCEEDED for item in plan.items}, {})
    assert plan_rest(PROBLEM, known(), state) is None


def test_work_moves_to_the_agent_that_has_time_when_the_other_is_late() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    over: dict[str, str] = {f"A-0{n}": Outcome.SUCCEEDED for n in (1, 2, 3, 4)}
    found = plan_rest(PROBLEM, known(), state_of(plan, 11.0, over, {"B": Running("B-01", 1.0)}))
    assert found is not None
    assert found[0].orders() == {"A": ("pick", "place", "pick", "place", "short", "short"), "B": ("long",)}
    assert [item.item_id for item in found[0].queue("A")][:4] == ["A-01", "A-02", "A-03", "A-04"]
    assert found[0].queue("A")[0].planned_start_s == 0.0  # what is over keeps its times


def test_what_failed_is_done_again_under_a_new_id_and_its_chain_goes_on() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    over = {"A-01": Outcome.SUCCEEDED, "A-02": Outcome.FAILED}
    found = plan_rest(PROBLEM, known(), state_of(plan, 6.0, over, {"B": Running("B-01", 6.0)}))
    assert found is not None
    queue = found[0].queue("A")
    assert [item.task for item in queue[:2]] == ["pick", "place"]
    assert queue[0].item_id == "A-01"
    ids = {item.item_id for item in found[0].items}
    assert "A-02" not in ids
    assert len(ids - {item.item_id for item in plan.items}) == 1
    assert len(ids) == len(found[0].items)


def test_a_chain_that_was_left_for_other_work_is_begun_again() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    over = {"A-01": Outcome.SUCCEEDED, "A-02": Outcome.FAILED, "B-01": Outcome.SUCCEEDED}
    found = plan_rest(PROBLEM, known(), state_of(plan, 12.0, over, {"A": Running("A-03", 1.0)}))
    assert found is not None
    check_plan(PROBLEM, found[0])
    assert [item.item_id for item in found[0].queue("A")][:2] == ["A-03", "A-04"]
    assert "A-01" not in {item.item_id for item in found[0].items}


def test_an_attempt_that_never_varied_and_is_late_takes_a_moment_more() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    rest = rest_of(PROBLEM, known(0.0), state_of(plan, 9.0, {}, {"A": Running("A-01", 9.0), "B": Running("B-01", 4.0)}))
    assert rest.begun.left_s["A"] == pytest.approx(0.01)
    assert rest.begun.left_s["B"] == pytest.approx(6.0)


@pytest.mark.parametrize(("since_s", "sigma"), [(1.0, 0.1), (9.0, 0.1), (12.0, 0.3), (20.0, 0.3)])
def test_what_is_left_of_an_attempt_is_that_of_work_which_lasts_longer(since_s: float, sigma: float) -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    rest = rest_of(PROBLEM, known(sigma), state_of(plan, since_s, {}, {"B": Running("B-01", since_s)}))
    work = 10.0 * np.exp(sigma * np.random.default_rng(0).standard_normal(2_000_000))
    longer = work[work > since_s] - since_s
    assert rest.begun.left_s["B"].mean() == pytest.approx(longer.mean(), abs=4 * longer.std() / 32**0.5 + 0.02)


def test_what_an_item_needs_and_how_long_it_may_take_stay_with_it() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    items = tuple(
        replace(item, needs=("drawing",), timeout_s=60.0) if item.item_id == "B-02" else item for item in plan.items
    )
    over = {f"A-0{n}": Outcome.SUCCEEDED for n in (1, 2, 3, 4)}
    state = state_of(replace(plan, items=items), 11.0, over, {"B": Running("B-01", 11.0)}, ("drawing",))
    found = plan_rest(PROBLEM, known(), state)
    assert found is not None
    kept = {item.item_id: item for item in found[0].items}
    for item in items:
        if item.item_id in kept:
            assert (kept[item.item_id].needs, kept[item.item_id].timeout_s) == (item.needs, item.timeout_s)
    if "B-02" in kept:
        assert found[0].arrivals == (Arrival("drawing", 11.0),)


def test_of_a_task_under_way_something_must_be_known() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    times = known()
    fewer = replace(times, times={key: time for key, time in times.times.items() if key != ("B", "long")})
    state = state_of(plan, 1.0, {}, {"B": Running("B-01", 1.0)})
    with pytest.raises(ScenarioError, match="long by B"):
        plan_rest(PROBLEM, fewer, state)


def test_the_closed_form_is_of_whole_plans() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    with pytest.raises(ScenarioError, match="closed-form: it judges whole plans"):
        plan_rest(PROBLEM, known(), state_of(plan, 1.0, {}, {}), Objective.CLOSED_FORM)


def test_the_same_state_and_seed_give_the_same_plan() -> None:
    plan = timed(make_plan(PROBLEM, ORDERS))
    over = {"A-01": Outcome.SUCCEEDED, "A-02": Outcome.FAILED}
    state = state_of(plan, 6.0, over, {"B": Running("B-01", 6.0)})
    one, other = (replanner(PROBLEM, known(), seed=4)(state, "failed") for _ in range(2))
    assert one is not None
    assert one == other


def test_the_rest_of_a_real_state_has_no_more_items_than_there_is_work() -> None:
    scenario = load_scenario("paper")
    [run] = runs(scenario, 1)
    starts = [place for place, event in enumerate(run.events) if isinstance(event, TaskStarted)]
    state = run_state(run.events[: starts[9] + 1])
    rest = rest_of(scenario.problem, sure_times(scenario), state)
    assert sum(len(items) for items in rest.fixed.values()) + sum(
        len(unit.tasks) * count for unit, count in zip(rest.space.units, rest.space.counts, strict=True)
    ) + sum(len(rest.space.begun[a]) - len(rest.fixed[a]) for a in rest.fixed) == len(state.plan.items)
    assert [i for items in rest.fixed.values() for i in items if isinstance(i, PlanItem)]
