"""The window without a browser: who may talk to it, its folder, the files that it writes, and the commands it runs."""

import asyncio
import json
import sys
import time
import tomllib
from pathlib import Path

import pytest

from cosim.study.study_file import source_files
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.signals import ChannelMap
from eightpost.window.parts import Folder


def window(name):
    """Return a module of the window; those that draw load NiceGUI, which is imported where a test needs it."""
    return pytest.importorskip(f"eightpost.window.{name}")


# ---- The window answers only the browser that opened its link, on its own address -----------------------------------

_PORT, _TOKEN = 8000, "token-of-the-link"


def _answer(*, kind="http", query=b"", **headers):
    """Return the status and headers of the answer to a request, or the code that closes a websocket."""
    sent, responses = [], pytest.importorskip("starlette.responses")

    async def send(message):
        sent.append(message)

    async def app(scope, receive, send):
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
        else:
            await responses.PlainTextResponse("the window")(scope, receive, send)

    given = {"host": f"127.0.0.1:{_PORT}", **headers}
    scope = {
        "type": kind, "method": "GET", "path": "/", "query_string": query,
        "headers": [(name.encode(), value.encode()) for name, value in given.items()],
    }  # fmt: skip
    asyncio.run(window("server")._Guard(app, _PORT, _TOKEN)(scope, None, send))
    first = sent[0]
    return first.get("status") or first["type"], {k.decode(): v.decode() for k, v in first.get("headers", [])}


_COOKIE = f"eightpost_{_PORT}={_TOKEN}"


@pytest.mark.parametrize(("request_headers", "status"), [
    ({"cookie": _COOKIE}, 200), ({"cookie": _COOKIE, "host": f"localhost:{_PORT}"}, 200),
    ({"cookie": _COOKIE, "origin": f"http://127.0.0.1:{_PORT}"}, 200), ({}, 403),
    ({"cookie": f"eightpost_{_PORT}=another"}, 403), ({"cookie": f"eightpost_8001={_TOKEN}"}, 403),
    ({"cookie": _COOKIE, "host": f"evil.example:{_PORT}"}, 403),
    ({"cookie": _COOKIE, "origin": "http://evil.example"}, 403), ({"cookie": _COOKIE, "origin": "null"}, 403),
])  # fmt: skip
def test_a_request_needs_the_cookie_the_own_host_and_the_own_origin(request_headers, status):
    assert _answer(**request_headers)[0] == status


def test_the_link_is_turned_into_a_cookie_that_scripts_and_other_sites_do_not_get():
    status, headers = _answer(query=f"token={_TOKEN}".encode())
    assert status == 303
    assert headers["location"] == "/"
    assert _TOKEN in headers["set-cookie"]
    assert {"httponly", "samesite=strict"} <= set(headers["set-cookie"].lower().split("; "))


def test_a_link_with_another_token_is_refused():
    assert _answer(query=b"token=guess")[0] == 403
    assert _answer(query=f"token={_TOKEN}".encode(), host="evil.example")[0] == 403


@pytest.mark.parametrize(("cookie", "answer"), [(_COOKIE, "websocket.accept"), ("", "websocket.close")])
def test_the_live_connection_needs_the_cookie_too(cookie, answer):
    assert _answer(kind="websocket", cookie=cookie)[0] == answer


# ---- Its folder ------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    return Folder.opened(tmp_path / "work")


def test_a_dropped_file_keeps_its_name_and_never_replaces_another(folder):
    first = folder.place("dyno", "run 7.csv")
    first.write_text("a")
    assert first == folder.path / "dyno" / "run 7.csv"
    assert folder.place("dyno", "run 7.csv").name == "run 7 2.csv"


@pytest.mark.parametrize("name", ["../../etc/passwd.csv", "..\\x.csv", "/x.csv", "a/b.csv", "...", "", "a\0b.csv"])
def test_a_dropped_file_stays_in_its_folder(folder, name):
    path = folder.place("rig", name)
    assert path.parent == folder.path / "rig"
    path.write_text("")


def test_only_files_of_the_folder_are_served(folder):
    (folder.path / "car.json").write_text("{}")
    (folder.path.parent / "secret.txt").write_text("no")
    (folder.path / "link").symlink_to(folder.path.parent / "secret.txt")
    assert folder.served("car.json") == folder.path / "car.json"
    for name in ("../secret.txt", "link", "dyno", "missing", str(folder.path.parent / "secret.txt")):
        assert folder.served(name) is None


def test_the_reading_of_a_record_is_kept_for_the_next_window(folder):
    record = folder.place("dyno", "a.csv")
    record.write_text("")
    assert (folder.reading(record), folder.words([record])) == ({}, [])
    folder.read_as(record, flip=["force"])
    assert folder.words([record]) == ["--channel", "force=-"]
    folder.read_as(record, map="dyno/a.map.toml")
    again = Folder.opened(folder.path)
    assert again.reading(record) == {"flip": ("force",), "channel_map": folder.path / "dyno/a.map.toml"}
    assert again.words([record]) == ["--channel", "force=-", "--channel", "dyno/a.map.toml"]


@pytest.mark.parametrize(("content", "message"), [
    ("[]", r"window.json: it must be an object, not \[\]"),
    ('{"readings": {"a.csv": {"map": ["x"]}}}', "a.csv.map: must be"),
    ('{"readings": {"a.csv": {"flip": "force"}}}', "readings.a.csv.flip: must be a list, not 'force'"),
])  # fmt: skip
def test_a_damaged_state_of_the_window_is_refused(folder, content, message):
    (folder.path / "window.json").write_text(content)
    with pytest.raises(InputError, match=message):
        Folder.opened(folder.path)


def test_records_that_are_read_in_different_ways_are_not_given_to_one_command(folder):
    records = [folder.path / "dyno" / name for name in ("a.csv", "b.csv")]
    folder.read_as(records[0], flip=["force"])
    with pytest.raises(InputError, match="one after the other"):
        folder.words(records)


def test_records_and_models_are_listed_by_their_content(folder):
    (folder.path / "dyno" / "a.csv").write_text("")
    (folder.path / "dyno" / "a.map.toml").write_text("")
    (folder.path / "shocks").mkdir()
    (folder.path / "shocks" / "a.json").write_text(json.dumps({"kind": "shock"}))
    (folder.path / "car.json").write_text(json.dumps({"kind": "vehicle"}))
    (folder.path / "broken.json").write_text("{")
    (folder.path / "my_car.toml").write_text('model = "seven_dof"')
    (folder.path / "system.toml").write_text("[components.car]")
    assert [path.name for path in folder.records("dyno")] == ["a.csv"]
    assert [path.name for path in folder.documents("shock")] == ["a.json"]
    assert [path.name for path in folder.documents("vehicle")] == ["car.json", "my_car.toml"]


def test_a_file_instead_of_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="name a folder"):
        Folder.opened(tmp_path / "file")


def test_the_map_that_the_window_writes_is_read_by_the_terminal(tmp_path):
    path = tmp_path / "rig_map.toml"
    window("records").write_map(path, {"lf.force": 'Damper "FL" µ', "lf.road": "WL FL Pos"}, {"lf.force"})
    assert {name: (pick.source, pick.gain) for name, pick in ChannelMap.read(path).channels.items()} == {
        "lf.force": ('Damper "FL" µ', -1.0), "lf.road": ("WL FL Pos", 1.0),
    }  # fmt: skip


# ---- System and study files are those that the commands read ---------------------------------------------------------


def test_a_run_couples_the_chosen_shock_at_every_corner(tmp_path):
    chosen = {"name": 'a "b"', "car": "car.toml", "drive": "tracks/lap 1.csv", "stop": 3}
    chosen |= {corner: f"shocks/{corner[1]}.json" for corner in CORNERS}
    window("system")._write_system(tmp_path / "runs" / "x" / "system.toml", chosen, tmp_path)
    written = tomllib.loads((tmp_path / "runs" / "x" / "system.toml").read_text())
    assert {name: Path(entry["fmu"]).relative_to(tmp_path / "fmus").as_posix()
            for name, entry in written["components"].items()} == {
        "car": "car.fmu", "lf": "f.fmu", "rf": "f.fmu", "lr": "r.fmu", "rr": "r.fmu",
    }  # fmt: skip
    assert [bond["between"] for bond in written["bond"]] == [[f"car.{corner}", corner] for corner in CORNERS]
    assert Path(written["scenario"]["drivefile"]) == tmp_path / "tracks" / "lap 1.csv"
    assert (written["name"], written["scenario"]["stop"]) == ('a "b"', 3.0)
    assert {"car.lr.tire_force", "rr.force", "car.front.ride_height"} <= {*written["scenario"]["record"]}


def test_a_study_names_the_files_that_were_chosen(tmp_path):
    chosen = {
        "name": "s", "car": "car.toml", "drive": "tracks/track.parquet", "baseline": "shocks/A.json", "alike": True,
        "bank": ["shocks/A.json", "shocks/B.json"], "objective": next(iter(window("system").OBJECTIVES)), "stop": 5,
    }  # fmt: skip
    window("system")._write_study(tmp_path / "studies" / "s" / "study.toml", chosen, tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in source_files(tmp_path / "studies" / "s" / "study.toml")}
    assert names == {"car.toml", "shocks/A.json", "shocks/B.json"}


def test_a_rig_record_drives_the_car_by_its_roads_and_loads(tmp_path):
    (tmp_path / "rig").mkdir()
    columns = {"lf.road": "WL FL Pos", "lf.aero": "AL FL", "lf.force": "Damper FL", "lf.tire_force": "WL FL Load"}
    window("records").write_map(tmp_path / "rig" / "rig_map.toml", columns, {"lf.force"})
    chosen = {"name": "lap", "car": "car.json", "drive": "rig/lap.csv", "stop": 3} | dict.fromkeys(CORNERS, "a.json")
    window("system")._write_system(tmp_path / "system.toml", chosen, tmp_path)
    scenario = tomllib.loads((tmp_path / "system.toml").read_text())["scenario"]
    assert scenario["targets"] == {"lf.road": "car.lf.road", "lf.aero": "car.lf.aero"}
    assert Path(scenario["channel_map"]) == tmp_path / "rig" / "rig_map.toml"


# ---- Commands: their progress, their end, and how they are cancelled -------------------------------------------------


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Start a job whose commands are Python programs."""
    parts = window("parts")
    monkeypatch.setattr(parts, "python_command", lambda _name, *words: [sys.executable, "-u", "-c", *words])
    jobs = []

    def start(*programs):
        jobs.append(parts.Job("work", [[program] for program in programs], tmp_path, tmp_path))
        return jobs[-1]

    yield start
    for job in jobs:
        job.close()


def _until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize(("code", "state"), [(0, "done"), (1, "not acceptable"), (2, "failed")])
def test_the_state_at_the_end_follows_the_exit_code(run, code, state):
    job = run(f"raise SystemExit({code})")
    _until(lambda: job.code is not None)
    assert job.state == state


def test_commands_run_one_after_the_other_until_one_fails(run):
    job = run("print('first')", "raise SystemExit(2)", "print('third')")
    _until(lambda: job.code is not None)
    assert (job.state, job.log) == ("failed", "first")


def test_the_last_line_of_progress_is_shown_and_is_no_part_of_the_log(run):
    lines = ["setups: 120 of 2401, 5%, about 0:01:10 left", "identifying: 40%", "error: 3 % is bad: no"]
    job = run(f"print({chr(10).join(lines)!r})")
    _until(lambda: job.code is not None)
    assert job.progress == (0.4, "identifying: 40%")
    assert job.log == "error: 3 % is bad: no"


def test_a_command_without_progress_has_none(run):
    job = run("print('x')")
    assert job.progress == (None, "")


def test_a_cancelled_command_is_interrupted_as_by_ctrl_c(run):
    job = run(
        "import time\ntry:\n    print('ready')\n    time.sleep(60)\nexcept KeyboardInterrupt:\n    print('stopped')",
        "print('never')",
    )
    _until(lambda: "ready" in job.log)
    assert job.state == "running"
    job.cancel()
    _until(lambda: job.code is not None)
    assert job.state == "cancelled"
    assert job.log.splitlines() == ["ready", "stopped"]


def test_a_command_that_does_not_stop_is_killed(run, monkeypatch):
    monkeypatch.setattr(window("parts"), "PATIENCE", 0.2)
    job = run("import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); print('ready'); time.sleep(60)")
    _until(lambda: "ready" in job.log)
    job.cancel()
    assert job.state == "stopping"
    _until(lambda: job.state == "cancelled")


def test_closing_the_window_ends_the_command(run):
    job = run("import time; time.sleep(60)")
    process = job._process
    job.close()
    assert process.poll() is not None


def test_commands_go_on_while_nobody_looks_at_them(run):
    opened = window("parts").Window(None)
    opened.jobs["x"] = job = run("print('first')", "print('second')")
    end = time.monotonic() + 20.0
    while "second" not in job.log:
        assert time.monotonic() < end
        opened.advance()
        time.sleep(0.01)
