"""`hrclog score`: usage, results, files, and bad input beside good."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from hrclog.analyzers.prediction.held_out import FORECASTS, MAKESPANS
from hrclog.analyzers.prediction.settings import SCORED
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.events import RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

pytestmark = pytest.mark.slow

Run = Callable[..., Any]

FIGURES = ("mae_s", "rmse_s", "crps_s", "coverage90", "interval_score_s", "log_likelihood")


@pytest.fixture
def campaign(samples: Path) -> Path:
    return samples / "campaign"


@pytest.fixture
def sides(samples: Path) -> tuple[str, ...]:
    """Return options of eight runs to learn from and two to predict."""
    one, more, later = (f"{samples}/campaign/paper_{name}.mcap" for name in ("000[0-4]", "000[5-7]", "001*"))
    return "--train", one, "--train", more, "--test", later


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "either LOG... or both --train and --test"),
        (("x", "--train", "a"), "either LOG... or both"),
        (("x", "--train", "a", "--test", "b"), "either LOG... or both"),
        (("--train", "a"), "--train and --test together"),
        (("--test", "a"), "--train and --test together"),
        (("x", "--static"), "--static goes with --train and --test"),
        (("--train", "a", "--test", "b", "--cv", "3"), "--cv goes with LOG..."),
        (("--train", "a", "--test", "b", "--transfer-deviation", "1"), "--transfer-deviation goes with --static"),
        (("--train", "a", "--test", "b", "--static", "--transfer-deviation", "-1"), "--transfer-deviation"),
        (("x", "--cv", "1"), "--cv"),
        (("x", "--seed", "-1"), "--seed"),
        (("x", "--estimator", "best"), "--estimator"),
        (("x", "--outliers", "best"), "--outliers"),
        (("--static",), "either LOG... or both"),
    ],
)
def test_wrong_usage_is_told_with_exit_2(run: Run, arguments: tuple[str, ...], expected: str) -> None:
    result = run("score", *arguments)
    assert result.code == 2
    assert result.out == ""
    assert expected in result.err


def test_folds_of_runs_are_scored_as_json(run: Run, campaign: Path) -> None:
    result = run("score", campaign, "--cv", "4", "--estimator", "aft", "--estimator", "mean", "--json")
    assert result.code == 0
    found = result.json()
    assert (found["setting"], found["n_train_runs"], found["n_test_runs"], found["n_executions"]) == ("cv", 9, 12, 288)
    assert list(found["estimators"]) == ["aft", "mean"]
    for figures in found["estimators"].values():
        assert all(isinstance(figures[name], float) for name in FIGURES)
        assert figures["n"] == 288
    assert "truth" not in found


def test_the_seed_decides_the_folds_and_nothing_else_does(run: Run, campaign: Path) -> None:
    def out(*arguments: object) -> str:
        result: str = run("score", *arguments, "--estimator", "mean", "--json").out
        return result

    backwards = sorted(campaign.glob("*.mcap"), reverse=True)
    assert out(campaign) == out(*backwards) == out(campaign, "--seed", "0", "--cv", "5")
    assert out(campaign, "--seed", "1") != out(campaign)


@pytest.mark.parametrize(("option", "setting"), [((), "prequential"), (("--static",), "static")])
def test_test_runs_are_predicted_from_training_runs(
    run: Run, sides: tuple[str, ...], option: tuple[str, ...], setting: str
) -> None:
    result = run("score", *sides, *option, "--estimator", "aft", "--json")
    assert result.code == 0
    found = result.json()
    assert (found["setting"], found["n_train_runs"], found["n_test_runs"]) == (setting, 8, 2)
    assert found["estimators"]["aft"]["calibrated"] is (setting == "prequential")


def test_the_text_has_every_estimator_agent_and_comparison(run: Run, campaign: Path) -> None:
    result = run("score", campaign, "--estimator", "ols", "--estimator", "mean")
    assert result.code == 0
    assert result.out.startswith("Each run predicted from others (cross-validation by run): 12 runs, 288 executions")
    for part in ("CRPS s", "makespan MAE s", "human", "robot", "How much lower the CRPS of ols is"):
        assert part in result.out
    assert "Not calibrated" not in result.out
    assert "not predicted" not in result.out


def test_a_static_forecast_says_that_it_is_not_calibrated(run: Run, sides: tuple[str, ...]) -> None:
    assert "Not calibrated" in run("score", *sides, "--static", "--estimator", "mean").out
    assert "Not calibrated" not in run("score", *sides, "--estimator", "mean").out


def test_an_estimator_named_twice_is_scored_once(run: Run, sides: tuple[str, ...]) -> None:
    once = run("score", *sides, "--estimator", "mean")
    assert run("score", *sides, "--estimator", "mean", "--estimator", "mean").out == once.out


def test_all_forecasts_are_written(run: Run, sides: tuple[str, ...], tmp_path: Path) -> None:
    result = run("score", *sides, "--estimator", "aft", "--estimator", "mean", "-o", tmp_path / "a" / "b", "--json")
    assert result.code == 0
    folder = tmp_path / "a" / "b"
    assert sorted(path.name for path in folder.iterdir()) == ["forecasts.parquet", "makespans.parquet", "score.json"]
    assert json.loads((folder / "score.json").read_text()) == result.json()
    forecasts, makespans = (pl.read_parquet(folder / f"{name}.parquet") for name in ("forecasts", "makespans"))
    assert (forecasts.schema, makespans.schema) == (FORECASTS, MAKESPANS)
    assert (forecasts.height, makespans.height) == (2 * 48, 2 * 2)


def test_an_output_folder_that_cannot_be_written_is_said_before_the_work(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run("score", tmp_path / "missing", "-o", tmp_path / "file" / "out")
    assert result.code == 1
    assert "choose another folder" in result.err


@pytest.mark.parametrize("side", ["logs", "--train", "--test"])
def test_one_unreadable_file_never_hides_the_others(
    run: Run, campaign: Path, sides: tuple[str, ...], tmp_path: Path, side: str
) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_text("not a log")
    more = (campaign, bad) if side == "logs" else (*sides, side, bad)
    result = run("score", *more, "--estimator", "mean", "--json")
    assert result.code == 3
    assert result.json()["estimators"]["mean"]["n"] > 0
    assert "bad.mcap" in result.err


@pytest.mark.parametrize("side", ["logs", "--train", "--test"])
def test_nothing_to_read_fails_with_one_sentence(run: Run, sides: tuple[str, ...], tmp_path: Path, side: str) -> None:
    missing = tmp_path / "missing.mcap"
    others = {
        "logs": (missing,),
        "--train": ("--train", missing, *sides[4:]),
        "--test": (*sides[:4], "--test", missing),
    }
    result = run("score", *others[side], "--estimator", "mean")
    assert result.code == 1
    assert result.out == ""
    assert str(missing) in result.err
    assert len(result.err.splitlines()) == 1


def test_the_same_run_on_both_sides_is_an_error(run: Run, sides: tuple[str, ...], campaign: Path) -> None:
    result = run("score", *sides, "--test", campaign / "paper_0003.mcap", "--estimator", "mean")
    assert result.code == 1
    assert "1 run is among both the training and the test runs" in result.err


def test_one_run_cannot_be_cross_validated(run: Run, samples: Path) -> None:
    result = run("score", samples / "single.mcap")
    assert result.code == 1
    assert "found 1 run and" in result.err


def test_a_transfer_deviation_that_is_no_number_is_an_error(run: Run, sides: tuple[str, ...]) -> None:
    for value in ("nan", "inf", "1000"):
        result = run("score", *sides, "--static", "--transfer-deviation", value, "--estimator", "mean")
        assert result.code == 1
        assert "expected 0 to 10" in result.err


def only(task: str, path: Path, *, outcome: str = "succeeded", runs: int = 3) -> Path:
    for number in range(runs):
        run, start = f"{path.name}{number}", number * 10**12
        write_log(
            path.with_name(f"{path.name}{number}.mcap"),
            [
                RunStarted(time_ns=start, run_id=run, name=run),
                TaskStarted(time_ns=start + 1, run_id=run, agent="Ж\x1b[31m", task=task, execution_id="e"),
                TaskEnded(
                    time_ns=start + 10**9, run_id=run, agent="Ж\x1b[31m", task=task, execution_id="e", outcome=outcome
                ),
                RunEnded(time_ns=start + 10**9, run_id=run),
            ],
        )
    return path.with_name(f"{path.name}*.mcap")


def test_runs_of_one_execution_are_enough_and_names_do_not_reach_the_terminal(run: Run, tmp_path: Path) -> None:
    result = run("score", only("tâche ☃", tmp_path / "a"))
    assert result.code == 0
    assert "Ж\\x1b[31m" in result.out
    assert "\x1b" not in result.out


def test_where_nothing_can_be_predicted_the_reason_is_told(run: Run, tmp_path: Path) -> None:
    train, test = only("a", tmp_path / "a"), only("b", tmp_path / "b")
    failed = only("c", tmp_path / "c", outcome="failed")
    for arguments, n in ((("--train", train, "--test", test), 3), ((failed,), 0)):
        result = run("score", *arguments, "--estimator", "aft")
        assert result.code == 1
        assert f"none of {n} successful executions could be predicted" in result.err


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from hrclog.sim.campaign import simulate_campaign
    from hrclog.sim.scenario import load_scenario

    folder = tmp_path_factory.mktemp("simulated")
    simulate_campaign(load_scenario("paper"), 12, 3, folder)
    return folder


def test_simulated_runs_are_compared_with_their_truth(run: Run, simulated: Path) -> None:
    truth = simulated / "truth.json"
    result = run(
        "score", simulated, "--truth", truth, "--cv", "2", "--estimator", "aft", "--estimator", "ols", "--json"
    )
    assert result.code == 0
    found = result.json()["truth"]
    assert set(found) == {"aft", "ols"}
    assert set(found["aft"]) == {"beside", "beside_strong", "free", "free_strong"}
    assert found["aft"]["beside"]["n"] > 20
    assert abs(found["aft"]["beside_strong"]["bias"]) < abs(found["ols"]["beside_strong"]["bias"])
    assert found["aft"]["beside"]["rmse"] < 0.2
    assert found["ols"]["free"]["n"] == 0
    text = run("score", simulated, "--truth", truth, "--cv", "2", "--estimator", "ols").out
    assert "Against the truth" in text
    assert "beside, s >= 1.8" in text


def test_a_wrong_truth_is_said_before_the_work(run: Run, simulated: Path, tmp_path: Path) -> None:
    known = json.loads((simulated / "truth.json").read_text())
    texts = {
        "missing.json": None,
        "text.json": "no",
        "list.json": "[]",
        "empty.json": "{}",
        "half.json": json.dumps(known | {"tasks": known["tasks"][1:]}),
    }
    for name, text in texts.items():
        if text is not None:
            (tmp_path / name).write_text(text)
        result = run("score", tmp_path / "no logs", "--truth", tmp_path / name, "--estimator", "mean")
        assert result.code == 1, name
        assert "truth" in result.err
        assert len(result.err.splitlines()) == 1


def test_the_truth_of_other_runs_is_an_error(run: Run, simulated: Path, tmp_path: Path) -> None:
    known = json.loads((simulated / "truth.json").read_text())
    for part in ("tasks", "synergies"):
        for one in known[part]:
            one.update({name: f"not {one[name]}" for name in ("agent", "other_agent") if name in one})
    (tmp_path / "truth.json").write_text(json.dumps(known))
    result = run("score", simulated, "--truth", tmp_path / "truth.json", "--estimator", "mean")
    assert result.code == 1
    assert "the truth knows none of the pairs" in result.err


def test_the_command_offers_every_estimator_and_outlier_method_and_shows_an_example(run: Run) -> None:
    result = run("score", "--help")
    assert result.code == 0
    assert f"[{'|'.join(SCORED)}]" in result.out
    assert f"[{'|'.join(OUTLIER_METHODS)}]" in result.out
    assert "Example:\n    hrclog score --cv 5" in result.out


def test_help_needs_no_statistics(tmp_path: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from hrclog.cli import main; main(['score', '--help']);"
        " assert not {'polars', 'scipy', 'numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=tmp_path)


def test_isolation_forest_can_be_asked_for(run: Run, campaign: Path, tmp_path: Path) -> None:
    shutil.copytree(campaign, tmp_path / "in")
    plain, trimmed = (
        run("score", tmp_path / "in", "--cv", "2", "--estimator", "ols", "--outliers", outliers, "--json").json()
        for outliers in OUTLIER_METHODS
    )
    assert plain["estimators"]["ols"]["crps_s"] != trimmed["estimators"]["ols"]["crps_s"]


def test_the_folds_are_as_many_as_were_asked_for(run: Run, simulated: Path) -> None:
    arguments = "score", simulated, "--estimator", "ols", "--json"
    texts = [run(*arguments, *cv).out for cv in ((), ("--cv", "5"), ("--cv", "2"))]
    assert texts[0] == texts[1]
    assert texts[1] != texts[2]
