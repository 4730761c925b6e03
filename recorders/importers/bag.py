"""The importer of ROS bags of any cell: one mapping file says what their topics mean."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hrclog.recorders.importers.heads import without_compression
from hrclog.recorders.importers.importer import Foreign, Importer, Option, Remark

_BEGINNINGS: Final = (b"\x89MCAP", b"SQLite format 3\0", b"#ROSBAG V")


class Bag(Importer):
    """Bags of ROS 2 (MCAP, SQLite) and ROS 1."""

    name = "bag"
    summary = "Import ROS bags; a mapping file says what their topics mean."
    description = (
        "Actions of ROS 2 and ROS 1, PlanSys2, Nav2, messages of your own, safety, speed, joints and other signals. "
        "--suggest lists the topics of a bag and writes a first mapping. Every id is derived from what the bag holds, "
        "so importing twice adds nothing."
    )
    example = "hrclog import bag monday/ --suggest > cell.toml\n  hrclog import bag monday/ --map cell.toml -o runs"
    options = (
        Option("map", "The mapping file, TOML; docs/bags.md describes it.", Path),
        Option("suggest", "List topics and print a first mapping; import nothing.", bool, False, only_shows=True),
    )

    def read(self, sources: Sequence[Path], **options: Any) -> Foreign:  # noqa: ANN401 - what its options hold
        """Return the runs of bags.

        Raises:
            MappingError: the mapping cannot be used: it says something wrong, or fits no bag.
            ImportDataError: there is no bag, or none can be read.
        """
        from hrclog.recorders.importers.bag_reading import read_bags

        return read_bags(sources, options.get("map"))

    def arguments_for(self, head: bytes, name: str) -> str | None:  # noqa: ARG002 - bags are known by their first bytes
        """Return how to come to a first mapping of a bag."""
        return "--suggest" if without_compression(head).startswith(_BEGINNINGS) else None

    def preview(self, sources: Sequence[Path], **options: Any) -> Remark | None:  # noqa: ANN401 - what its options hold
        """Return a first mapping, if it was asked for.

        Raises:
            ImportDataError: there is no bag, or none can be read.
        """
        from hrclog.recorders.importers.bag_reading import suggest_mapping

        return suggest_mapping(sources) if options.get("suggest") else None
