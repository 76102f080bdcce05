"""A client in plain Zenoh, run as a process of its own: nothing of ours is imported, docs/wire.md is all it knows.

python -I plain_client.py ENDPOINT CELL    prints what it found as one JSON object
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

import zenoh
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from zenoh import ext

DEADLINE_S = 20.0
FIELD = descriptor_pb2.FieldDescriptorProto
# foxglove.RawImage as the page has it: name, number, protobuf's number for the type
IMAGE_FIELDS = (
    ("timestamp", 1, FIELD.TYPE_MESSAGE),
    ("width", 2, FIELD.TYPE_FIXED32),
    ("height", 3, FIELD.TYPE_FIXED32),
    ("encoding", 4, FIELD.TYPE_STRING),
    ("step", 5, FIELD.TYPE_FIXED32),
    ("data", 6, FIELD.TYPE_BYTES),
    ("frame_id", 7, FIELD.TYPE_STRING),
)


def image_class() -> Any:
    """The protobuf class of an image, made from the field numbers alone."""
    file = descriptor_pb2.FileDescriptorProto(
        name="raw_image.proto", package="foxglove", syntax="proto3", dependency=["google/protobuf/timestamp.proto"]
    )
    message = file.message_type.add(name="RawImage")
    for name, number, kind in IMAGE_FIELDS:
        field = message.field.add(name=name, number=number, type=kind, label=FIELD.LABEL_OPTIONAL)
        if kind == FIELD.TYPE_MESSAGE:
            field.type_name = ".google.protobuf.Timestamp"
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.RawImage"))


class Client:
    """Subscribes and asks."""

    def __init__(self, session: zenoh.Session, cell: str) -> None:
        self._session, self._root = session, f"crosspih/{cell}/"
        self._heard: dict[str, list[tuple[str, bytes]]] = {}
        self._changed = threading.Condition()
        self._declared: list[Any] = []

    def listen(self, path: str, advanced: bool) -> None:
        """Keep every sample: a state or event by an advanced subscriber, who is told the newest when late."""

        def receive(sample: zenoh.Sample) -> None:
            label = sample.attachment.to_string() if sample.attachment is not None else ""
            with self._changed:
                self._heard.setdefault(path, []).append((label, sample.payload.to_bytes()))
                self._changed.notify_all()

        if advanced:
            entity: Any = ext.declare_advanced_subscriber(
                self._session,
                self._root + path,
                receive,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        else:
            entity = self._session.declare_subscriber(self._root + path, receive)
        self._declared.append(entity)

    def heard(self, path: str, count: int = 1) -> list[tuple[str, bytes]]:
        """(label, payload) of the samples so far, once there are so many."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._heard.get(path, [])) >= count, DEADLINE_S):
                sys.exit(f"{path}: {len(self._heard.get(path, []))} samples, want {count}")
            return list(self._heard[path])

    def ask(self, path: str, label: str | None, request: dict[str, Any]) -> tuple[str, str]:
        """(label, payload) of the one reply; of a refusal the label is "error"; both empty where nobody serves."""
        attachment = None if label is None else label.encode()
        replies = list(
            self._session.get(
                self._root + path, payload=json.dumps(request).encode(), attachment=attachment, timeout=DEADLINE_S
            )
        )
        if not replies:
            return "", ""
        (reply,) = replies
        if reply.ok is None:
            assert reply.err is not None
            return "error", reply.err.payload.to_string()
        given = reply.ok.attachment
        return given.to_string() if given is not None else "", reply.ok.payload.to_string()

    def ask_until_served(self, path: str, label: str | None, request: dict[str, Any]) -> tuple[str, str]:
        """As `ask`; a declaration takes a moment to come through the router."""
        until = time.monotonic() + DEADLINE_S
        while True:
            answer = self.ask(path, label, request)
            if answer != ("", ""):
                return answer
            if time.monotonic() > until:
                sys.exit(f"{path}: nobody serves it")

    def alive(self) -> list[str]:
        """Whose tokens there are."""
        tokens = self._session.liveliness().get(self._root + "service/*/alive")
        return sorted(str(reply.ok.key_expr).split("/")[-2] for reply in tokens if reply.ok is not None)

    def hold(self) -> str:
        """Take the arm, and beat until the process ends; the lease, empty where the cell knows of none."""
        request = {"holder": "plain", "purpose": "a test"}
        label, answer = self.ask("arm/lease/take", "crosspih.TakeLease/1", request)
        if not label:
            return ""
        granted = json.loads(answer)
        publisher = self._session.declare_publisher(self._root + "arm/lease/beat/plain")
        beat = {"lease": granted["lease"], "holder": granted["holder"]}

        def beats() -> None:
            for seq in range(1_000_000):
                payload = json.dumps({"stamp_ns": -1, "seq": seq, **beat}).encode()
                try:
                    publisher.put(payload, attachment=f"crosspih.LeaseBeat/1 {seq}".encode())
                except zenoh.ZError:
                    return
                pause.wait(granted["beat_s"])

        pause = threading.Event()
        threading.Thread(target=beats, daemon=True).start()
        return str(granted["lease"])


def main(endpoint: str, cell: str) -> None:
    """Do all that a client does, once."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        client = Client(session, cell)
        for path, advanced in (
            ("clock", True),
            ("camera/calibration", True),
            ("camera/left/image", True),
            ("arm/dwell/request", True),
            ("arm/dwell/reply", True),
            ("arm/joint_state", False),
            ("ft/raw", False),
        ):
            client.listen(path, advanced)
        found: dict[str, Any] = {}
        # both were published before we came
        found["clock"], found["calibration"] = client.heard("clock")[0], client.heard("camera/calibration")[0]
        lease = client.hold()
        held = {"lease": lease} if lease else {}
        dwell = {**held, "duration_s": 0.1}
        found["dwell"] = client.ask_until_served("arm/dwell", "crosspih.Dwell/1", dwell)
        found["dwell_echoes"] = client.heard("arm/dwell/request")[-1], client.heard("arm/dwell/reply")[-1]
        found["joint_state"] = client.heard("arm/joint_state", 10)
        found["raw"] = client.heard("ft/raw", 3)
        found["no_label"] = client.ask("arm/dwell", None, dwell)
        found["wrong_version"] = client.ask("arm/dwell", "crosspih.Dwell/99", dwell)
        found["unknown_field"] = client.ask("arm/dwell", "crosspih.Dwell/1", {**dwell, "hurry": True})
        found["out_of_bounds"] = client.ask("arm/dwell", "crosspih.Dwell/1", {**dwell, "duration_s": 1e9})
        found["refused"] = client.ask(
            "arm/guarded_move",
            "crosspih.GuardedMove/1",
            {**held, "direction_base": [0, 0, 1], "speed_m_s": 1e-6, "travel_limit_m": 0.3},
        )
        found["unserved"] = client.ask("arm/no_such_command", "crosspih.Dwell/1", dwell)
        found["capture"] = client.ask_until_served("camera/capture", "crosspih.CaptureStereo/1", {})
        label, payload = client.heard("camera/left/image")[-1]
        image = image_class().FromString(payload)
        found["image"] = {
            "label": label,
            "stamp_ns": image.timestamp.ToNanoseconds(),
            "width": image.width,
            "height": image.height,
            "step": image.step,
            "bytes": len(image.data),
            "encoding": image.encoding,
            "frame_id": image.frame_id,
            "mean": sum(image.data) / len(image.data),
        }
        found["alive"] = client.alive()
        found["ours"] = [
            name for name in sys.modules if name.split(".")[0] in ("crosspih_common", "services", "deploy")
        ]
    print(json.dumps(found, default=lambda payload: payload.decode()))


if __name__ == "__main__":
    main(*sys.argv[1:])
