"""Identifiers."""

from __future__ import annotations

import random
import uuid
from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from hrclog.ids import NAMESPACE, Uuid7Generator, derived_id, new_id


def test_a_new_id_is_a_uuid_of_version_7_with_the_current_time() -> None:
    clock = 1_700_000_000_123_456_789
    value = uuid.UUID(Uuid7Generator(lambda: clock)())
    assert (value.version, value.variant) == (7, uuid.RFC_4122)
    assert value.int >> 80 == clock // 1_000_000


@given(st.lists(st.integers(-(10**9), 2**62), min_size=2, max_size=50), st.integers(0))
def test_ids_sort_in_the_order_in_which_they_were_made_whatever_the_clock_does(clock: list[int], seed: int) -> None:
    ticks = iter(clock)
    generator = Uuid7Generator(lambda: next(ticks), random.Random(seed).getrandbits)
    ids = [generator() for _ in clock]
    assert ids == sorted(set(ids))
    assert all((uuid.UUID(text).version, uuid.UUID(text).variant) == (7, uuid.RFC_4122) for text in ids)


def test_ids_of_one_millisecond_sort_even_from_the_largest_random_start() -> None:
    generator = Uuid7Generator(lambda: 0, lambda bits: (1 << bits) - 1)
    ids = [generator() for _ in range(10_000)]
    assert ids == sorted(set(ids))


def test_the_same_seed_and_clock_give_the_same_ids() -> None:
    first, second = (Uuid7Generator(lambda: 10**18, random.Random(5).getrandbits) for _ in range(2))
    assert [first() for _ in range(5)] == [second() for _ in range(5)]


def test_ids_from_many_threads_are_distinct() -> None:
    with ThreadPoolExecutor(8) as pool:
        ids = list(pool.map(lambda _: new_id(), range(20_000)))
    assert len(set(ids)) == len(ids)


def test_a_derived_id_is_a_uuid_of_version_5_and_depends_on_nothing_but_its_parts() -> None:
    assert uuid.UUID(derived_id("mongo", "run 1")).version == 5
    assert derived_id("mongo", "run 1") == derived_id("mongo", "run 1")
    assert derived_id("a") == str(uuid.uuid5(NAMESPACE, "1:a"))


@given(st.lists(st.lists(st.text(max_size=3), max_size=3), unique_by=tuple, max_size=10))
def test_different_parts_give_different_derived_ids(sources: list[list[str]]) -> None:
    assert len({derived_id(*parts) for parts in sources}) == len(sources)


@given(st.lists(st.text(max_size=6), max_size=4))
def test_a_derived_id_is_the_uuid5_of_its_parts(parts: list[str]) -> None:
    text = "".join(f"{len(part)}:{part}" for part in parts)
    assert derived_id(*parts) == str(uuid.uuid5(NAMESPACE, text))
