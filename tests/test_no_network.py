"""No verb opens a connection: there is no telemetry, and pages and plots need nothing from outside."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"

#: Runs commands in a process in which every use of an Internet address raises an error; sockets within the machine
#: that asyncio and multiprocessing use have no such address. Audit hooks also see what C code of Python does.
OFFLINE = """
import sys

def audit(event, arguments):
    if event in ("socket.connect", "socket.sendto", "socket.getaddrinfo", "socket.gethostbyname", "urllib.Request"):
        if event != "socket.connect" or not isinstance(arguments[-1], (str, bytes)):  # a text is a file in this machine
            sys.stderr.write(f"NETWORK {event} {arguments!r}\\n")
            raise PermissionError(f"{event} {arguments!r}")

sys.addaudithook(audit)
from click.testing import CliRunner
from eightpost.__main__ import main
for command in eval(sys.argv[1]):
    shown = CliRunner().invoke(main, command)
    print(command[0], shown.exit_code, flush=True)
    if shown.exit_code:
        print(shown.output, repr(shown.exception))
"""


@pytest.fixture(scope="module")
def ran(quarter_car_system, tmp_path_factory):
    folder = tmp_path_factory.mktemp("offline")
    (folder / "system.toml").write_text(quarter_car_system, encoding="utf-8")
    commands = [
        ["doctor"],
        ["new", str(folder / "starter")],
        ["inspect", str(EXAMPLES / "data" / "dyno_A.csv")],
        ["run", str(folder / "system.toml"), "-o", str(folder / "out"), "--report"],
    ]
    command = [sys.executable, "-c", OFFLINE, repr(commands)]
    return commands, subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False)


@pytest.mark.nightly
def test_verbs_work_where_every_connection_is_refused(ran):
    commands, process = ran
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines() == [f"{command[0]} 0" for command in commands]
    assert "NETWORK" not in process.stderr


def test_the_audit_of_these_tests_sees_a_connection(tmp_path):
    attempt = "\nimport socket\nsocket.create_connection(('192.0.2.1', 9), timeout=0.1)\n"
    code = OFFLINE.partition("from click")[0] + attempt
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert process.returncode != 0 and "NETWORK" in process.stderr


#: Modules that talk to other machines, and functions of them that do not.
NETWORK = {"ftplib", "http", "poplib", "requests", "smtplib", "socket", "ssl", "telnetlib", "urllib", "xmlrpc"}
HARMLESS = ("urllib.parse", "urllib.request.pathname2url", "urllib.request.url2pathname")


def imported(tree: ast.AST) -> set[str]:
    """Return the modules of plain imports and the dotted names of `from ... import ...`."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("package", ["builder", "cosim", "eightpost", "fmus"])
def test_no_source_imports_a_function_for_connections(package):
    faults = []
    for path in (ROOT / package).rglob("*.py"):
        for name in imported(ast.parse(path.read_text(encoding="utf-8"))):
            if name.partition(".")[0] in NETWORK and not name.startswith(HARMLESS):
                faults.append(f"{path.relative_to(ROOT)}: {name}")
    assert not faults
