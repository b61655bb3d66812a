"""docker-compose.yml: its services' very commands, environment, keys and health checks, as processes of this machine.

No container engine is needed. What a container has from its image and from compose is given another way: services are
found on 127.0.0.1 at free ports, secrets and volumes are folders of this test's own.
"""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import IO, Any

import pytest
from ruamel.yaml import YAML
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from entoptic.services.console import protocol
from entoptic.services.ipc.addresses import free_addresses
from entoptic.services.process import cache_folder

ROOT = Path(__file__).parents[2]
GIVE_UP_S = 150.0
"""A worker compiles first, unless this machine has done so before."""
PORT = re.compile(r"(?<=[:=])(\d{4,5})\b")
PATH = re.compile(r"(?<![\w/.:])/[a-z][\w./]*")


@cache
def compose() -> dict[str, Any]:
    text = (ROOT / "docker-compose.yml").read_text(encoding="utf-8")
    loaded: dict[str, Any] = YAML(typ="safe").load(re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", text))
    return loaded


def services() -> dict[str, dict[str, Any]]:
    """Those that `docker compose up` starts."""
    return {name: service for name, service in compose()["services"].items() if "profiles" not in service}


@cache
def image_environment() -> dict[str, str]:
    """ENV of the Dockerfile's last stage."""
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    last_stage = dockerfile[dockerfile.rindex("\nFROM ") :]
    pairs = [each for line in re.findall(r"^ENV (.*)$", last_stage, re.MULTILINE) for each in shlex.split(line)]
    return {name: value for name, _, value in (pair.partition("=") for pair in pairs) if name != "PATH"}


def mounts(service: dict[str, Any]) -> list[str]:
    """Paths below which a container can write, or finds its keys."""
    volumes = [each.split(":")[1] for each in service.get("volumes", [])]
    return [*volumes, *service["tmpfs"], *(each["target"] for each in service.get("secrets", []))]


class Machine:
    """All services, each a process, found where the test says."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ports: dict[str, str] = {}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._logs: dict[str, IO[bytes]] = {}
        subprocess.run(
            [sys.executable, "-m", "entoptic", *self._arguments("keys")], check=True, cwd=ROOT, capture_output=True
        )
        for name in services():
            self._give_keys(name)

    def start(self) -> None:
        """In no order: each has to wait for the others by itself, as after a restart."""
        for name in services():
            self._start(name)

    def wait_until_healthy(self) -> None:
        give_up_s = time.monotonic() + GIVE_UP_S
        for name in self.processes:
            while not self.is_healthy(name):
                assert time.monotonic() < give_up_s, f"{name} is not healthy\n{self.said()}"

    def is_healthy(self, name: str) -> bool:
        """As its health check says."""
        if (process := self.processes.get(name)) is None:
            return False
        assert process.poll() is None, f"{name} ended\n{self.said()}"
        kind, program, *arguments = services()[name]["healthcheck"]["test"]
        assert kind == "CMD"
        command = {"entoptic": [sys.executable, "-m", "entoptic"], "python": [sys.executable]}[program]
        done = subprocess.run(
            [*command, *(self._here(each, name) for each in arguments)],
            env=self._environment(name),
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=60,
        )
        return done.returncode == 0

    def url(self, name: str) -> str:
        """Where its published port is."""
        (published,) = services()[name]["ports"]
        host, _, port = published.split(":")
        return f"http://{host}:{self._port(port)}"

    def said(self) -> str:
        """By all processes, for a person who looks into a failed test."""
        return "\n".join(f"--- {path.stem}\n{path.read_text()[-2000:]}" for path in self._folder.glob("*.log"))

    def stop(self) -> dict[str, int]:
        """SIGTERM to all, as `docker compose down`; their exit statuses."""
        (grace,) = {each["stop_grace_period"] for each in services().values()}
        give_up_s = time.monotonic() + float(grace.removesuffix("s"))
        for process in self.processes.values():
            process.send_signal(signal.SIGTERM)
        return {name: each.wait(max(give_up_s - time.monotonic(), 0)) for name, each in self.processes.items()}

    def close(self) -> None:
        for process in self.processes.values():
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        for log in self._logs.values():
            log.close()

    def _start(self, name: str) -> None:
        self._logs[name] = (self._folder / f"{name}.log").open("wb")
        self.processes[name] = subprocess.Popen(
            [sys.executable, "-m", "entoptic", *self._arguments(name)],
            env=self._environment(name),
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=self._logs[name],
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def _arguments(self, name: str) -> list[str]:
        return [self._here(each, name) for each in compose()["services"][name]["command"]]

    def _environment(self, name: str) -> dict[str, str]:
        given = image_environment() | compose()["services"][name].get("environment", {})
        return {**os.environ, **{key: self._here(str(value), name) for key, value in given.items()}}

    def _here(self, text: str, service: str) -> str:
        """A word of a command, with places of this machine."""
        hosts = "|".join([*compose()["services"], "renderer"])
        text = re.sub(rf"(?<=://)({hosts})(?=:\d)", "127.0.0.1", text)
        if "://" in text or text.startswith("--port"):
            text = PORT.sub(lambda found: self._port(found[1]), text)
        return PATH.sub(lambda found: str(self._place(found[0], service)), text) if "://" not in text else text

    def _port(self, inside: str) -> str:
        if inside not in self._ports:
            self._ports[inside] = free_addresses().states.rpartition(":")[2]
        return self._ports[inside]

    def _place(self, path: str, service: str) -> Path:
        """A volume is the same for all services, all else each one's own; what is compiled is kept for the next run."""
        for volume in compose()["services"][service].get("volumes", []):
            source, target = volume.split(":")
            if path == target or path.startswith(f"{target}/"):
                of_all = cache_folder().parent if source == "cache" else self._folder / "volumes" / source.strip("./")
                of_all.mkdir(parents=True, exist_ok=True)
                return of_all / path.removeprefix(target).strip("/")
        return self._folder / "containers" / service / path.strip("/")

    def _give_keys(self, name: str) -> None:
        """To each service those that it is granted, no others."""
        for granted in services()[name].get("secrets", []):
            made = self._folder / "volumes" / compose()["secrets"][granted["source"]]["file"].removeprefix("./")
            place = self._place(granted["target"], name)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(made, place)


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    opened = Machine(tmp_path)
    yield opened
    opened.close()


def frames_and_states(url: str, cookie: str) -> Iterator[tuple[bool, bool]]:
    """What the console's page is sent: whether a frame as perceived, whether states of eyes."""
    headers = {"Cookie": cookie} if cookie else {}
    with connect(f"{url.replace('http', 'ws', 1)}/live", origin=url, additional_headers=headers, max_size=None) as page:
        while True:
            message = page.recv(timeout=GIVE_UP_S)
            if isinstance(message, bytes):
                yield message[0] == protocol.PERCEIVED and message[5:8] == b"\xff\xd8\xff", False
            else:
                yield False, any(one["type"] == "traces" and one["t_s"] for one in json.loads(message))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="containers are stopped by SIGTERM, which Windows does not have")
def test_its_commands_show_the_stand_in_on_the_page_and_end_when_told(machine: Machine) -> None:
    machine.start()
    machine.wait_until_healthy()
    url = machine.url("console")
    with urllib.request.urlopen(url, timeout=10) as answer:
        assert b"<html" in answer.read()
        cookie = (answer.headers["set-cookie"] or "").partition(";")[0]
    seen = [0, 0]
    give_up_s = time.monotonic() + GIVE_UP_S
    try:
        for frame, states in frames_and_states(url, cookie):
            seen = [seen[0] + frame, seen[1] + states]
            if min(seen) >= 2:
                break
            assert time.monotonic() < give_up_s, f"frames, states: {seen}\n{machine.said()}"
    except ConnectionClosed as closed:
        pytest.fail(f"{closed}\n{machine.said()}")
    assert machine.stop() == dict.fromkeys(machine.processes, 0), machine.said()


def test_every_service_is_shut_in() -> None:
    for name, service in compose()["services"].items():
        uid, _, gid = service["user"].partition(":")
        assert int(uid) > 0, name
        assert int(gid) > 0, name
        assert (service["read_only"], service["cap_drop"]) == (True, ["ALL"]), name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", [])), name
        assert "privileged" not in service, name
    assert compose()["networks"]["session"] == {"internal": True}


def test_every_service_that_goes_on_is_looked_after() -> None:
    for name, service in compose()["services"].items():
        if name != "keys":
            assert service["restart"] == "unless-stopped", name
            assert service["healthcheck"]["test"], name
            assert {"max-size", "max-file"} <= set(service["logging"]["options"]), name


def test_every_path_is_one_that_a_container_has() -> None:
    """A root that is read-only has no place for what was forgotten."""
    for name, service in compose()["services"].items():
        for word in service["command"]:
            for path in PATH.findall(word) if "://" not in word else []:
                assert any(there.startswith(path) or path.startswith(there) for there in mounts(service)), (name, path)
        for volume in service.get("volumes", []):
            source = volume.partition(":")[0]
            assert source.startswith("./") or source in compose()["volumes"], (name, source)
        for granted in service.get("secrets", []):
            assert granted["source"] in compose()["secrets"], (name, granted)


def test_every_key_is_one_that_the_keys_service_makes(machine: Machine, tmp_path: Path) -> None:
    for secret in compose()["secrets"].values():
        assert (tmp_path / "volumes" / secret["file"].removeprefix("./")).is_file(), secret


def test_the_image_has_every_folder_that_a_volume_is_mounted_at_and_no_root() -> None:
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    last_stage = dockerfile[dockerfile.rindex("\nFROM ") :]
    made = re.search(r"install -d -m 1777 (.*)", last_stage)
    assert made is not None
    named = {
        volume.split(":")[1]
        for service in services().values()
        for volume in service.get("volumes", [])
        if not volume.startswith("./")
    }
    assert named <= set(made[1].split())
    user = re.search(r"^USER (\d+):(\d+)$", last_stage, re.MULTILINE)
    assert user is not None
    assert int(user[1]) > 0
    sources = [words.split()[:-1] for words in re.findall(r"^COPY (?!--from)(.*)$", dockerfile, re.MULTILINE)]
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines() if line[:1] == "!"}
    for source in {each for copied in sources for each in copied}:
        assert (ROOT / source).exists(), source
        assert source in kept, source
