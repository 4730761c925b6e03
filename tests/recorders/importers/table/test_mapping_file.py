"""Mappings survive their files, and every preset is one."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import HrclogError
from hrclog.recorders.importers.table.mapping import SOURCE_FIELDS, WORD_FIELDS, Source, TableMapping, missing_roles
from hrclog.recorders.importers.table.mapping_file import mapping_text, parse_mapping, read_mapping, write_mapping
from hrclog.recorders.importers.table.presets import preset_families, presets_of, read_preset
from hrclog.recorders.importers.table.recognition import preset_names

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=6)
COLUMNS = st.builds(Source, column=TEXTS, pattern=st.sampled_from(["", "(.+)", "_([^_]+)$"]))
SOURCES = COLUMNS | st.builds(Source, constant=TEXTS)
FORM = {"event": st.just(None), "time": st.just(None)}
MAPPINGS = st.builds(
    TableMapping,
    **{name: st.none() | SOURCES for name in SOURCE_FIELDS} | FORM,
    **{name: st.lists(TEXTS, max_size=2).map(tuple) for name in WORD_FIELDS},
    run=st.lists(COLUMNS, max_size=2).map(tuple),
    tag_columns=st.lists(TEXTS, max_size=2).map(tuple),
    tags=st.dictionaries(TEXTS, TEXTS, max_size=2),
    unit=st.sampled_from(["", "s", "days"]),
    run_gap_s=st.none() | st.floats(0, 100),
    has_header=st.booleans(),
    delimiter=st.sampled_from(["", ";", "\t"]),
)


@settings(max_examples=80)
@given(MAPPINGS)
def test_a_mapping_survives_its_file(mapping: TableMapping) -> None:
    assert parse_mapping(mapping_text(mapping), Path("m.toml")).mapping == mapping


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_says_what_it_is_for_and_all_that_is_needed(name: str) -> None:
    preset = read_preset(name)
    assert preset.about
    assert preset.columns or preset.n_columns
    assert missing_roles(preset.mapping) == []


def test_a_family_of_presets_is_chosen_by_its_name() -> None:
    assert preset_families() == ["boris", "elan", "lerobot", "plansys2"]
    assert len(presets_of("boris")) == 3
    assert len(presets_of("boris-tabular-7")) == 1


def test_a_mapping_is_never_written_over_a_file(tmp_path: Path) -> None:
    write_mapping(tmp_path / "m.toml", TableMapping(unit="s"))
    assert read_mapping(tmp_path / "m.toml").mapping == TableMapping(unit="s")
    with pytest.raises(HrclogError, match="exists already"):
        write_mapping(tmp_path / "m.toml", TableMapping())


@pytest.mark.parametrize(
    "text",
    ["[columns]\nagnt = 'x'", "[columns]\nagent = 7", "[nonsense]", "no", "[times]\nunit = 'hours'", "columns = 3",
     "[columns]\nagent = {column = 'a', pattern = '('}", "[columns]\ntime = 't'"],
)  # fmt: skip
def test_a_bad_mapping_is_one_error_that_names_the_file(text: str) -> None:
    with pytest.raises(HrclogError, match=r"m\.toml"):
        parse_mapping(text, Path("m.toml"))
