"""Finished files are, to the byte, those of the mcap library."""

from __future__ import annotations

import io

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from hrclog.log.writing.finished import McapFile

TIMES = st.integers(0, 2**64 - 1)
TEXTS = st.text(max_size=5)
FACTS = st.dictionaries(TEXTS, TEXTS, max_size=2)
MESSAGES = st.tuples(
    st.just("message"), st.integers(1, 3), TIMES, st.binary(max_size=40), TIMES, st.integers(0, 2**32 - 1)
)
STEPS = st.lists(
    st.tuples(st.just("schema"), TEXTS, TEXTS, st.binary(max_size=9))
    | st.tuples(st.just("channel"), TEXTS, TEXTS, st.integers(0, 3), FACTS)
    | st.tuples(st.just("metadata"), TEXTS, FACTS)
    | st.tuples(st.just("attachment"), TIMES, TIMES, TEXTS, TEXTS, st.binary(max_size=40))
    | MESSAGES,
    max_size=30,
)


@settings(max_examples=150)
@given(STEPS, st.integers(1, 400))
def test_a_file_is_that_of_the_mcap_library(steps: list[tuple[object, ...]], chunk_size: int) -> None:
    streams = io.BytesIO(), io.BytesIO()
    ours, theirs = McapFile(streams[0], chunk_size), Writer(streams[1], chunk_size=chunk_size, enable_data_crcs=True)
    for writer in (ours, theirs):
        writer.start("ros2", "test")
        for kind, *values in steps:
            adding = {
                "schema": writer.register_schema, "channel": writer.register_channel, "metadata": writer.add_metadata,
                "message": writer.add_message, "attachment": writer.add_attachment,
            }  # fmt: skip
            adding[str(kind)](*values)
        writer.finish()
    assert streams[0].getvalue() == streams[1].getvalue()
