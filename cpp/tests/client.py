"""The C++ client behind the calls of the Python one, so that both run the same scenarios.

Each session, each watch and the other calls of a client have a driver process of their own. Poses and
errors become what the Python package would give; nothing is tried again or decided here.
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import fields

import grpc
import numpy as np
from covis import IngestReport, LinkOptions, RejectedItem, RetryPolicy, Violation, _poses, errors, v1

KINDS = (
    "argument", "invalid_url", "invalid_token", "token_in_plain_text", "unreachable", "protocol",
    "too_large", "rejected", "not_durable", "fenced", "map_replaced", "server_restarted", "items_lost",
    "map_not_open", "retries_exhausted", "closed", "timeout", "callback", "rpc",
)  # fmt: skip
"""`covis::ErrorKind`, in its order."""


class Failed(errors.CovisError):
    """An error for which no test asks by its type; the text begins with its kind."""


def _error(answer):
    kind, text = KINDS[answer["error"]], answer["text"]
    if kind == "rejected":
        return errors.Rejected([
            RejectedItem(item["sequence"], tuple(Violation(*one) for one in item["violations"]))
            for item in answer["items"]
        ])  # fmt: skip
    if kind == "rpc":
        code = next(code for code in grpc.StatusCode if code.value[0] == answer["code"])
        rpc, _, text = text.partition(": ")
        found = errors._CLASSES.get(code, errors.RpcError)(rpc, None, text)
        found.code = code
        return found
    if kind == "retries_exhausted":
        return errors.RetriesExhausted(answer["attempts"], Failed(answer["cause"]))
    if kind == "timeout":
        return TimeoutError(text)
    made = {
        "fenced": errors.Fenced,
        "map_replaced": errors.MapReplaced,
        "server_restarted": errors.ServerRestarted,
        "items_lost": errors.ItemsLost,
        "too_large": errors.TooLarge,
        "closed": errors.Closed,
        "not_durable": errors.NotDurable,
    }.get(kind)
    if made is None:
        return Failed(f"{kind}: {text}")
    found = made.__new__(made)
    Exception.__init__(found, text)
    return found


class Driver:
    """A driver process, which holds a connection."""

    def __init__(self, url, link):
        self._process = subprocess.Popen(
            [os.environ["COVIS_CPP_DRIVER"]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        times = (link.keep_alive_s, link.keep_alive_timeout_s, link.deadline_s)
        self.ask("connect", url, *(round(s * 1000) for s in times))

    def ask(self, *words):
        self._process.stdin.write(" ".join(map(_word, words)) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"the driver ended: {self._process.wait()}"
        answer = json.loads(line)
        if "error" in answer:
            raise _error(answer)
        return answer

    def close(self):
        self._process.stdin.close()
        assert self._process.wait() == 0
        self._process.stdout.close()


def _word(value):
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def _retry(policy):
    return (policy.max_attempts, *(round(s * 1000) for s in (policy.first_delay_s, policy.longest_delay_s)))


def _ms(timeout):
    return 0 if timeout is None else round(timeout * 1000)


class Client:
    def __init__(self, url, *, link=LinkOptions()):
        self._url, self._link = url, link
        self._drivers = []
        self._calls = self._driver()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for driver in self._drivers:
            driver.close()

    def _driver(self):
        self._drivers.append(Driver(self._url, self._link))
        return self._drivers[-1]

    def server_info(self):
        return self._calls.ask("server_info")

    def ingest(self, map_id, client_id, *, lock_step=False, max_unanswered=64, retry=RetryPolicy(), on_ack=None):
        driver = self._driver()
        opened = driver.ask("ingest", map_id, client_id, int(lock_step), max_unanswered, *_retry(retry))
        return Session(driver, opened, on_ack)

    def refine_pose(self, K, world_from_camera, points, pixels):
        rows = np.column_stack([points, pixels])
        intrinsics = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        words = (*intrinsics, *np.ravel(world_from_camera), len(rows), *np.ravel(rows))
        row = self._calls.ask("refine", *words)["pose"]
        return _poses.join_pose(row[:3], row[3:])

    def wait_settled(self, map_id, timeout=None):
        self._calls.ask("settled", map_id, _ms(timeout))

    def watch(self, map_id, *, retry=RetryPolicy()):
        driver = self._driver()
        driver.ask("watch", map_id, *_retry(retry))
        return Map(driver)


class Session:
    def __init__(self, driver, opened, on_ack):
        self._driver, self._on_ack = driver, on_ack
        self.opened = v1.IngestOpened(**opened)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind is None:
            self._driver.ask("finish", 0)
        else:
            self._driver.ask("abort")

    @property
    def next_sequence(self):
        return self._driver.ask("next")["sequence"]

    @property
    def next_keyframe_id(self):
        return self._driver.ask("next")["keyframe"]

    @property
    def next_landmark_id(self):
        return self._driver.ask("next")["landmark"]

    @property
    def report(self):
        answer = self._driver.ask("report")
        for sequence, status in answer["acks"]:
            if self._on_ack is not None:
                self._on_ack(v1.IngestAck(sequence=sequence, status=status))
        return IngestReport(**{f.name: answer[f.name] for f in fields(IngestReport) if f.name in answer})

    def camera(self, id, width, height, K):
        return self._driver.ask("camera", id, width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])["sequence"]

    def keyframe(self, *, id, t, world_from_camera, pixels, landmark_ids, depths, new_points):
        rows = np.column_stack([pixels, depths, new_points])
        seen = [word for landmark, row in zip(landmark_ids, rows) for word in (landmark, *row)]
        pose = np.ravel(world_from_camera)
        return self._driver.ask("keyframe", id, round(t * 1e9), *pose, len(rows), *seen)["sequence"]

    def closure(self, id, i, j, i_from_j, information):
        packed = information[np.triu_indices(6)]
        return self._driver.ask("closure", id, i, j, *np.ravel(i_from_j), *packed)["sequence"]

    def landmarks(self, count):
        """So many landmarks, all at one place."""
        return self._driver.ask("landmarks", count)["sequence"]

    def flush(self, timeout=None):
        self._driver.ask("flush", 0, _ms(timeout))

    def wait_durable(self, sequence=None, timeout=None):
        self._driver.ask("wait_durable", sequence or 0, _ms(timeout))

    def wait_optimized(self, sequence=None, timeout=None):
        self._driver.ask("wait_optimized", sequence or 0, _ms(timeout))

    def wait_settled(self, timeout=None):
        self._driver.ask("wait_settled", _ms(timeout))

    @property
    def unanswered(self):
        """As requests of the wire, in hexadecimal digits from the driver."""
        found = self._driver.ask("unanswered")["items"]
        return tuple(v1.IngestRequest.FromString(bytes.fromhex(item)) for item in found)

    def finish(self, timeout=None):
        self._driver.ask("finish", _ms(timeout))
        return self.report

    def abort(self):
        self._driver.ask("abort")


class Map:
    def __init__(self, driver):
        self._driver = driver

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    @property
    def poses(self):
        return {id: _poses.join_pose(row[:3], row[3:]) for _, id, *row in self._driver.ask("map")["poses"]}

    @property
    def landmarks(self):
        rows = self._driver.ask("map")["landmarks"]
        return {id: np.array(row or [np.nan] * 3) for _, id, *row in rows}

    @property
    def constraints(self):
        return self._driver.ask("map")["constraints"]

    def map_from_odom(self, client_id):
        frames = {name: row for name, *row in self._driver.ask("map")["frames"]}
        row = frames.get(client_id)
        return _poses.join_pose(row[:3], row[3:]) if row else None

    def scale(self, client_id):
        return dict(self._driver.ask("map")["scales"]).get(client_id, 1.0)

    def wait(self, revision, timeout=None):
        self._driver.ask("wait_revision", revision, _ms(timeout))

    def wait_until(self, is_met, timeout=None):
        while True:
            revision = self._driver.ask("map")["revision"]
            if is_met():
                return
            self.wait(revision + 1, timeout)
