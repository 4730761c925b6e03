"""A planned end before its planned start unsets both, wherever the two were told."""

from __future__ import annotations

from event_frames import event, frame
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.projections.intervals import rebuild

INSTANTS = st.none() | st.integers(0, 9)


@settings(max_examples=60)
@given(st.lists(st.tuples(INSTANTS, INSTANTS, st.booleans()), min_size=1, max_size=4))
def test_both_are_unset_where_the_end_is_before_the_start_and_kept_elsewhere(
    planned: list[tuple[int | None, int | None, bool]],
) -> None:
    rows = []
    for number, (start, end, is_split) in enumerate(planned):
        identity = {"execution_id": f"e{number}"}
        told = {} if is_split else {"planned_end_ns": end}
        if is_split:
            rows.append(event("task_dispatched", number, planned_end_ns=end, **identity))
        rows.append(event("task_started", number, planned_start_ns=start, **told, **identity))
        rows.append(event("task_ended", number + 1, **identity))
    executions, remarks = rebuild(frame(rows))
    kept = dict(
        zip(executions["execution_id"], executions.select("planned_start_ns", "planned_end_ns").rows(), strict=True)
    )
    turned = [start is not None and end is not None and end < start for start, end, _ in planned]
    expected = [(None, None) if is_turned else row[:2] for row, is_turned in zip(planned, turned, strict=True)]
    assert [kept[f"e{number}"] for number in range(len(planned))] == expected
    assert [remark.code for remark in remarks] == ["planned_backwards"] * any(turned)
    for remark in remarks:
        assert f"{sum(turned)} execution" in remark.message
