"""The folder of a campaign: its logs, and the files needed to resume it after it was killed.

While a campaign is under way, `.campaign` in its folder holds

    manifest.json  which campaign it is
    NAME.json      the truth about a run whose log is written
    NAME.draft     a file that is being written, and moved out when it is whole

so that the folder itself never holds half a file. When all runs are there, truth.json is written and `.campaign`
removed, its manifest first.
"""

from __future__ import annotations

import filecmp
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog._version import __version__
from hrclog.errors import LogExistsError, LogWriteError, OutputError, ScenarioError
from hrclog.event_rows import parse_details
from hrclog.files import HIDDEN, lock, remedy_for, sync_folder, write_whole
from hrclog.json_text import RESULT_JSON, read_json_file
from hrclog.log.files.system import replace_atomically
from hrclog.log.one_log import read_log
from hrclog.log.writing.writer import write_log
from hrclog.sim.run import Run, run_id_of, run_name
from hrclog.sim.scenario import Scenario
from hrclog.sim.truth import (
    TRUTH_FILE,
    RunTruth,
    Truth,
    compact_json,
    read_truth,
    run_from_json,
    run_to_json,
    write_truth,
)
from hrclog.tags import NO_TAGS, TAGS
from hrclog.wording import counted

WORK_FOLDER: Final = ".campaign"
_MANIFEST: Final = "manifest.json"
_RUNS: Final = "*_*.json"
_LEFTOVERS: Final = (HIDDEN, "*.draft")
_ELSEWHERE: Final = "choose an empty folder with -o"


@dataclass(frozen=True, slots=True)
class Manifest:
    """Which campaign a folder is for: what the bytes of its runs depend on, and how many there will be.

    `cell_digest` and `safety` are "" where no physical cell is simulated.
    """

    scenario: str
    digest: str
    cell_digest: str
    seed: int
    engine: str
    safety: str
    version: str
    runs: int
    tags: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        guarded = f", safety {self.safety}" if self.safety else ""
        tagged = "".join(f", {key}={value}" for key, value in self.tags.items())
        return (
            f"{counted(self.runs, 'run')} of {self.scenario}, seed {self.seed}, engine {self.engine}{guarded}{tagged}"
        )


def manifest_of(scenario: Scenario, runs: int, seed: int, engine: str, tags: Mapping[str, str] = NO_TAGS) -> Manifest:
    """Return the manifest of a campaign."""
    cell = scenario.cell if engine == "bullet" else None
    return Manifest(
        scenario=scenario.name,
        digest=scenario.digest,
        cell_digest=scenario.cell_digest if cell else "",
        seed=seed,
        engine=engine,
        safety=cell.safety.policy if cell else "",
        version=__version__,
        runs=runs,
        tags=dict(sorted(tags.items())),
    )


@contextmanager
def campaign_folder(scenario: Scenario, manifest: Manifest, path: Path) -> Iterator[CampaignFolder]:
    """Make a folder ready for a campaign, new or resumed, and keep other processes out of it meanwhile.

    Args:
        scenario: names the runs.
        manifest: of the campaign.
        path: of the folder.

    Raises:
        LogExistsError: the folder holds something else that is in the way.
        LogWriteError: another process is at it, or it cannot be written.
        OutputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(path, f"cannot be made ({error.strerror})") from error
    with _folder_lock(path):
        folder = CampaignFolder(
            path,
            manifest,
            lambda index: run_name(scenario, index),
            lambda index: run_id_of(scenario, manifest.seed, index, manifest.engine),
        )
        folder.begin()
        try:
            yield folder
        finally:
            folder.leave()


class CampaignFolder:
    """A folder in which one campaign is under way.

    `resumed` says whether it was before; `done` holds the truth about the runs that are there, by number.

    Args:
        path: the folder.
        manifest: of the campaign.
        name_of: returns the name of the run of a number.
        id_of: returns the id of the run of a number.
    """

    def __init__(
        self, path: Path, manifest: Manifest, name_of: Callable[[int], str], id_of: Callable[[int], str]
    ) -> None:
        self.path = path
        self.resumed = False
        self.done: dict[int, RunTruth] = {}
        self._work_folder = path / WORK_FOLDER
        self._manifest = manifest
        self._name_of = name_of
        self._id_of = id_of

    def log(self, index: int) -> Path:
        """Return the log of a run."""
        return self.path / f"{self._name_of(index)}.mcap"

    def begin(self) -> None:
        """Check that nothing else is in the way, clear up, and find the runs that are there.

        Raises:
            LogExistsError: something is in the way.
            LogWriteError: the folder cannot be written.
        """
        unfinished, finished = self._unfinished_manifest(), None
        if unfinished is None:
            with suppress(OSError):
                self._clear_work_folder()  # a campaign was killed when it had hardly begun, or was all but over
            finished = self._finished_truth()
            if finished is None:
                self._check_empty()
        else:
            self._check_same_campaign(unfinished)
        with _write_errors(self._work_folder):
            self._work_folder.mkdir(exist_ok=True)
            _remove(self._work_folder, *_LEFTOVERS)
        if unfinished != self._manifest:
            text = compact_json(asdict(self._manifest)).encode()
            replace_atomically(self._work_folder / _MANIFEST, lambda stream: stream.write(text))
        if finished:
            with _write_errors(self._work_folder):
                for run in finished.runs:
                    write_whole(self._work_folder / f"{run.name}.json", compact_json(run_to_json(run)).encode())
        self.resumed = unfinished is not None or finished is not None
        self.done = self._finished_runs()

    def finish(self, truth: Truth) -> None:
        """Write the truth about all runs, and leave nothing else behind.

        Raises:
            LogWriteError: the folder cannot be written.
        """
        draft = self._work_folder / "truth.draft"
        write_truth(draft, truth)
        with _write_errors(self.path):
            draft.replace(self.path / TRUTH_FILE)
            sync_folder(self.path)
            self._clear_work_folder()

    def leave(self) -> None:
        """Keep the files needed to resume; without any run, remove all of them."""
        if not any(self.log(index).exists() for index in range(self._manifest.runs)):
            with suppress(OSError):
                self._clear_work_folder()

    def _unfinished_manifest(self) -> Manifest | None:
        """Return the manifest of the campaign that is under way here."""
        path = self._work_folder / _MANIFEST
        try:
            return Manifest(**read_json_file(path, RESULT_JSON))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError, TypeError) as error:
            remedy = (
                f"it cannot be read as a campaign of this hrclog ({error}); remove {self._work_folder} or {_ELSEWHERE}"
            )
            raise LogExistsError(path, remedy) from error

    def _finished_truth(self) -> Truth | None:
        """Return the truth of the finished campaign that this one goes on with, None if there is none such."""
        manifest = self._manifest
        try:
            truth = read_truth(self.path / TRUTH_FILE)
        except ScenarioError:
            return None
        existing = replace(
            manifest, scenario=truth.scenario, seed=truth.seed, engine=truth.engine, safety=truth.safety or ""
        )
        count = len(truth.runs)
        all_exist = all(self.log(index).exists() for index in range(count))
        none_beyond = not any(self.log(index).exists() for index in range(count, manifest.runs))
        # ids depend on all that the scenario says
        same_ids = [run.run_id for run in truth.runs] == [self._id_of(index) for index in range(count)]
        return (
            truth
            if existing == manifest
            and count < manifest.runs
            and all_exist
            and none_beyond
            and same_ids
            and self._is_same_kind()
            else None
        )

    def _is_same_kind(self) -> bool:
        """Return whether the first log here is of this version, which alone gives the same bytes, and of these tags."""
        started = read_log(self.log(0)).events.filter(pl.col("kind") == "run_started")
        facts = parse_details(str(started["details"].first() or ""))
        software = facts.get("software", {})
        is_same_version = isinstance(software, dict) and software.get("hrclog") == self._manifest.version
        return is_same_version and facts.get(TAGS, {}) == self._manifest.tags

    def _check_empty(self) -> None:
        """Raise if a file would be overwritten."""
        for path in (self.path / TRUTH_FILE, *map(self.log, range(self._manifest.runs))):
            if path.exists():
                raise LogExistsError(path, _ELSEWHERE + self._finished_campaign_text())

    def _finished_campaign_text(self) -> str:
        try:
            truth = read_truth(self.path / TRUTH_FILE)
        except ScenarioError:
            return ""
        safety = truth.safety or ""
        manifest = Manifest(truth.scenario, "", "", truth.seed, truth.engine, safety, "", len(truth.runs))
        return f" (a finished campaign is there: {manifest})"

    def _check_same_campaign(self, unfinished: Manifest) -> None:
        """Raise unless the campaign that is under way is this one, and the number of runs can still be chosen."""
        manifest = self._manifest
        if replace(unfinished, runs=manifest.runs) != manifest:
            description = str(unfinished)
            if unfinished.version != manifest.version:
                description += f", by hrclog {unfinished.version}"
            elif (
                replace(unfinished, runs=manifest.runs, digest=manifest.digest, cell_digest=manifest.cell_digest)
                == manifest
            ):
                description += ", whose scenario said something else"
            remedy = f"it is an unfinished campaign: {description}; finish it with its own command or {_ELSEWHERE}"
            raise LogExistsError(self._work_folder, remedy)
        extra_indices = [index for index in range(manifest.runs, unfinished.runs) if self.log(index).exists()]
        if extra_indices:
            remedy = (
                f"the unfinished campaign here is longer: ask for at least {extra_indices[-1] + 1} runs or {_ELSEWHERE}"
            )
            raise LogExistsError(self.log(extra_indices[0]), remedy)
        for path in map(self.log, range(unfinished.runs, manifest.runs)):
            if path.exists():
                raise LogExistsError(
                    path, f"the unfinished campaign here ({unfinished}) did not write it; {_ELSEWHERE}"
                )

    def _finished_runs(self) -> dict[int, RunTruth]:
        truths: dict[int, RunTruth] = {}
        for index in range(self._manifest.runs):
            truth = _read_run(self._work_folder / f"{self._name_of(index)}.json")
            if truth is not None and self.log(index).exists():
                truths[index] = truth
        return truths

    def _clear_work_folder(self) -> None:
        _remove(self._work_folder, _MANIFEST, _RUNS, *_LEFTOVERS)  # without its manifest, a campaign is over
        with suppress(OSError):  # somebody else keeps files there
            self._work_folder.rmdir()


def add_run(path: Path, run: Run) -> None:
    """Write the log of a run into the folder of its campaign, then the truth about it: each whole, or not at all.

    Args:
        path: the folder.
        run: what to write.

    Raises:
        LogExistsError: another log of that name is there; one that is the same is left as it is.
        LogWriteError: a file cannot be written.
    """
    name = run.truth.name
    log, draft = path / f"{name}.mcap", path / WORK_FOLDER / f"{name}.draft"
    write_log(draft, run.events, run.signals)
    with _write_errors(log):
        if not log.exists():
            draft.replace(log)
        else:
            same = filecmp.cmp(draft, log, shallow=False)
            draft.unlink()
            if not same:
                remedy = f"it is not what run {name} of this campaign gives; move it away or {_ELSEWHERE}"
                raise LogExistsError(log, remedy)
        # not synced, which would take as long again: where a crash of the operating system damages it, the run is made
        # again
        truth_path = draft.with_suffix(".json")
        write_whole(truth_path, compact_json(run_to_json(run.truth)).encode())


def _read_run(path: Path) -> RunTruth | None:
    try:
        return run_from_json(read_json_file(path, RESULT_JSON))
    except (OSError, ValueError, KeyError, TypeError):  # without it the run is made again
        return None


def _remove(folder: Path, *patterns: str) -> None:
    for pattern in patterns:
        for path in list(folder.glob(pattern)):
            path.unlink()


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    """Turn an OSError into a LogWriteError."""
    try:
        yield
    except OSError as error:
        reason = f"cannot be written ({error.strerror})"
        raise LogWriteError(path, reason, remedy_for(error, "choose a folder that can be written")) from error


@contextmanager
def _folder_lock(path: Path) -> Iterator[None]:
    """Lock a folder. The lock always ends with the process."""
    if os.name != "posix":
        yield
        return
    try:
        fd = os.open(path, os.O_RDONLY)
    except OSError as error:
        raise OutputError(path, f"cannot be read ({error.strerror})") from error
    try:
        if not lock(fd, wait=False):
            remedy = "wait until it is done, or choose another folder with -o"
            raise LogWriteError(path, "another process is simulating into this folder", remedy)
        yield
    finally:
        os.close(fd)
