"""What leaves the store is what is in it: CSV to the digit, MCAP to the bit, and thinning out keeps the numbers."""

import argparse
import base64
import csv
import json

import numpy as np
import pytest
from jsonschema import validate
from mcap.reader import make_reader
from picking_fakes import Lab

from evg_app.cli import trials as verb
from evg_app.errors import BadInput
from evg_app.trials import arrays
from evg_app.trials.export import export_csv
from evg_app.trials.export_mcap import TOPICS, export_mcap
from evg_app.trials.foxglove import SCHEMAS
from evg_app.trials.keep import POLICIES, prune, sizes
from evg_app.trials.labels import add_label
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.recorder import Recorder
from evg_app.trials.rows import read_rows
from evg_app.trials.summary import summary


@pytest.fixture
def run(tmp_path):
    lab = Lab(script="SFSS", objects=3)
    with Recorder(tmp_path / "run", {"a": 1}, {}) as recorder:
        lab.listeners.append(recorder)
        lab.run()
    return tmp_path / "run"


def rows_of(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def command(*words):
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    args = parser.parse_args(["trials", *map(str, words)])
    return args.run(args)


def test_csv_tables_hold_the_rows_and_the_final_labels(run, tmp_path):
    wrong = read_rows(run).passes[0]["attempt_id"]
    add_label(run, wrong, False)
    assert command("export", run, "--csv", tmp_path / "csv") == 0
    attempts, facts = rows_of(tmp_path / "csv" / "attempts.csv"), summary(run)
    assert len(attempts) == facts["passes"] and {r["failure"] for r in attempts} == {"", "nothing held after lift"}
    judged = rows_of(tmp_path / "csv" / "attempts_judged.csv")
    assert sum(int(r["success"]) for r in judged) == facts["successes"]
    first = next(r for r in judged if r["attempt_id"] == wrong)
    assert (first["success"], first["automatic_success"], first["operator_label"]) == ("0", "1", "0")
    assert rows_of(tmp_path / "csv" / "labels.csv")[0]["source"] == "review"


def test_a_place_that_cannot_be_written_is_bad_input(run, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        command("export", run, "--csv", tmp_path / "file")
    with pytest.raises(OSError):
        export_csv(run, tmp_path / "file")


def test_mcap_holds_depth_frames_grasps_and_events_in_order(run, tmp_path):
    count = export_mcap(run, tmp_path / "run.mcap")
    by_topic: dict[str, list] = {topic: [] for topic in TOPICS}
    stamps = []
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema.name == TOPICS[channel.topic] and channel.message_encoding == "json"
            assert schema.encoding == "jsonschema" and json.loads(schema.data) == SCHEMAS[schema.name]
            validate(json.loads(message.data), SCHEMAS[schema.name])
            by_topic[channel.topic].append(json.loads(message.data))
            stamps.append(message.log_time)
    assert len(stamps) == count and stamps == sorted(stamps)
    recorded = RecordedRun(run)
    stored = recorded.attempt(recorded.attempt_ids[0]).stored
    image = by_topic["/camera/depth"][0]
    depth = np.frombuffer(base64.b64decode(image["data"]), "<u2").reshape(image["height"], image["width"])
    assert (
        np.array_equal(depth, stored["depth"]) and image["encoding"] == "16UC1" and image["step"] == 2 * depth.shape[1]
    )
    cloud = by_topic["/camera/points"][0]
    points = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, 3)
    assert cloud["point_stride"] == 12 and points[:, 2] == pytest.approx(0.6 + 0.5), "camera at 0.6 m, depth 0.5 m"
    assert by_topic["/grasp"][0]["poses"][0]["position"]["z"] == pytest.approx(stored["T_base_grasp"][2, 3])
    kinds = [m["kind"] for m in by_topic["/events"]]
    assert kinds[0] == "RunStarted" and kinds[-1] == "RunFinished" and kinds.count("AttemptFinished") == 4
    assert {m["child_frame_id"] for m in by_topic["/tf"]} == {"task", "camera"}


def test_the_verb_says_how_many_messages(run, tmp_path, capsys):
    assert command("export", run, "--mcap", tmp_path / "x.mcap") == 0
    assert "messages in" in capsys.readouterr().out


@pytest.mark.parametrize(("policy", "left"), [("executed", 4), ("failures", 1), ("labelled", 2), ("none", 0)])
def test_thinning_out_keeps_numbers_and_pictures_and_what_the_policy_says(run, policy, left):
    before = summary(run)
    for row in read_rows(run).passes[:2]:
        add_label(run, row["attempt_id"], bool(row["truth"]))
    files, freed = prune(run, policy)
    assert files == 4 - left and (freed > 0) == (left < 4) and policy in POLICIES
    size = sizes(run)
    assert size["attempts_with_arrays"] == left == len(RecordedRun(run).attempt_ids)
    assert len(list((run / "attempts").glob("*.png"))) == 4
    after = summary(run)
    for key in ("gsr", "dr", "attempts", "failure_reasons", "stage_ms", "verdicts"):
        assert after[key] == before[key]


def test_the_size_of_a_run_is_said(run, capsys):
    assert command("prune", run) == 0
    assert "arrays of 4 attempts" in capsys.readouterr().out
    assert command("prune", run, "--keep", "none") == 0
    assert "deleted the arrays of 4 attempts" in capsys.readouterr().out
    assert "depth" not in [name for path in run.rglob("*.npz") for name in arrays.read(path)]


def test_a_label_from_the_command_line_is_kept_beside_the_automatic_one(run, capsys):
    attempt = read_rows(run).passes[1]["attempt_id"]
    assert command("label", run, attempt[:-2], "success", "--note", "it was there") == 0
    operator = summary(run)["operator"]
    assert (operator["only_operator_success"], operator["labelled"]) == (1, 1)
    assert operator["disagreeing_attempts"] == [attempt] and attempt in capsys.readouterr().out
