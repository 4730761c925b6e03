"""Turn messages into facts by a mapping, whatever transport they come by."""

from __future__ import annotations

from collections.abc import Iterator

from hrclog.diagnostic import Diagnostic
from hrclog.errors import MappingError
from hrclog.log.messages.failures import Failures
from hrclog.recorders.mapping.actions import Action
from hrclog.recorders.mapping.facts import Fact, Notes
from hrclog.recorders.mapping.fields import UnknownFieldError
from hrclog.recorders.mapping.mapping import Mapping
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.received import Received
from hrclog.wording import counted


class Engine:
    """What one source of messages says: a recording, or a live connection.

    Attributes:
        rule: where runs begin.
        notes: what is to be told beside the facts.

    Args:
        mapping: what topics mean.
    """

    def __init__(self, mapping: Mapping) -> None:
        self.meanings, self.rule = mapping.meanings()
        self.notes = Notes()
        self._path = mapping.path
        self._failures = Failures()
        self._by_topic: dict[tuple[str, str], list[Meaning]] = {}
        self._began = False

    def wants(self, topic: str, type_name: str) -> bool:
        """Return whether messages of a topic are needed."""
        return bool(self._meanings_of(topic, type_name))

    def definition(self, topic: str, type_name: str) -> str:
        """Return the definition of a topic's type that the mapping tells, "" for none."""
        return next(filter(None, (meaning.definition for meaning in self._meanings_of(topic, type_name))), "")

    @staticmethod
    def wants_nothing(_topic: str, _type_name: str) -> bool:
        """Return False, for those who look for topics only."""
        return False

    def unmatched(self, topics: set[tuple[str, str]]) -> list[Meaning]:
        """Return the meanings for which there is no topic among these (topic, type)s."""
        met = {id(meaning) for topic in topics for meaning in self._meanings_of(*topic)}
        return [meaning for meaning in self.meanings if id(meaning) not in met]

    def take(self, received: Received) -> Iterator[Fact]:
        """Return what a message says; messages come in order of log time.

        Raises:
            MappingError: the mapping names a field that messages of this type do not have.
        """
        if not self._began:
            self.notes.begin_ns, self._began = received.time_ns, True
        for meaning in self._meanings_of(received.topic, received.type_name):
            try:
                yield from meaning.take(received, self.notes)
            except UnknownFieldError as error:
                kind = f" ({received.type_name})" if received.type_name else ""
                raise MappingError(self._path, [f"{meaning.where}: topic {received.topic}{kind}: {error}"]) from error
            except (ValueError, TypeError, OverflowError) as error:
                self._failures.add(received.topic, str(error), received.time_ns)

    def finish(self) -> Iterator[Fact]:
        """Return what is known when no further message comes."""
        for meaning in self.meanings:
            yield from meaning.finish(self.notes)

    def diagnostics(self, path: str) -> list[Diagnostic]:
        """Return what is to be told of the source.

        Args:
            path: of the source.
        """
        diagnostics: list[Diagnostic] = []

        def complain(code: str, text: str, offset: int | None) -> None:
            diagnostics.append(Diagnostic(code, text, path, offset=offset))

        self._failures.report(complain, "skipped_message", "cannot be used")
        for (code, sentence), count in self.notes.remarks.items():
            what = "message" if code == "unmapped_value" else "execution"
            diagnostics.append(Diagnostic(code, sentence.replace("{}", counted(count, what), 1), path))
        return diagnostics

    def _meanings_of(self, topic: str, type_name: str) -> list[Meaning]:
        key = (topic, type_name)
        if key not in self._by_topic:
            wanting = [meaning for meaning in self.meanings if meaning.wants(topic, type_name)]
            actions = [meaning for meaning in wanting if isinstance(meaning, Action)]
            self._by_topic[key] = [meaning for meaning in wanting if meaning not in actions[1:]]
        return self._by_topic[key]
