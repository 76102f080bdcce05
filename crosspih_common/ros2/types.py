"""ROS 2 messages by rosbags: their classes, CDR, and the type hashes (RIHS01, REP 2016) that stand in keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from crosspih_common.errors import ConfigError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

Distro = Literal["humble", "jazzy", "kilted", "lyrical"]
DISTROS: tuple[Distro, ...] = ("humble", "jazzy", "kilted", "lyrical")
TRIGGER = "std_srvs/srv/Trigger"
EVENT_INFO = "service_msgs/msg/ServiceEventInfo"
NO_HASH = "TypeHashNotSupported"  # what rmw_zenoh writes on humble, which has no type hashes


class RosTypes:
    """The messages of one ROS 2 distribution. Raises ConfigError where the extra `ros2` is not installed."""

    def __init__(self, distro: Distro = "jazzy") -> None:
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise ConfigError(
                "ros2: rosbags is not installed, which knows ROS 2's messages; pip install 'crosspih[ros2]'"
            ) from None
        self.distro = distro
        self.store: Typestore = get_typestore(Stores(f"ros2_{distro}"))
        self._hashes: dict[str, str] = {}
        self.add_service(TRIGGER, [], [("success", "bool"), ("message", "string")])

    def add_service(self, name: str, request: list[tuple[str, str]], response: list[tuple[str, str]]) -> None:
        """Add a service by the fields (name, basic type) of its request and response; rosbags itself has none."""
        definitions: dict[str, list[tuple[str, Any]]] = {
            f"{name}_Request": [(field, _basic(kind)) for field, kind in request],
            f"{name}_Response": [(field, _basic(kind)) for field, kind in response],
        }
        self.register(definitions)
        self.describe_service(name)

    def register(self, definitions: dict[str, list[tuple[str, Any]]]) -> None:
        """Further types by their fields, in rosbags' own form."""
        typed: Typesdict = {name: ([], fields) for name, fields in definitions.items()}
        self.store.register(typed)

    def describe_service(self, name: str) -> None:
        """The service as a type: its request, response and event stand in it, and its hash is the hash of that."""
        from rosbags.interfaces import Nodetype

        events: dict[str, list[tuple[str, Any]]] = {}
        if EVENT_INFO in self.store.fielddefs:
            # its `char[16]` is uint8[16] to ROS 2 (rosidl_adapter), by which the hashes of all services are made
            constants, fields = self.store.fielddefs[EVENT_INFO]
            sixteen: Any = (Nodetype.ARRAY, ((Nodetype.BASE, ("uint8", 0)), 16))
            mended = [(field, sixteen if field == "client_gid" else kind) for field, kind in fields]
            self.store.fielddefs[EVENT_INFO] = (constants, mended)
            events[f"{name}_Event"] = [
                ("info", (Nodetype.NAME, EVENT_INFO)),
                ("request", (Nodetype.SEQUENCE, ((Nodetype.NAME, f"{name}_Request"), 1))),
                ("response", (Nodetype.SEQUENCE, ((Nodetype.NAME, f"{name}_Response"), 1))),
            ]
            events[name] = [
                ("request_message", (Nodetype.NAME, f"{name}_Request")),
                ("response_message", (Nodetype.NAME, f"{name}_Response")),
                ("event_message", (Nodetype.NAME, f"{name}_Event")),
            ]
            self.register(events)

    def make(self, name: str, /, **fields: Any) -> Any:
        """A message of a type; every field must be given."""
        return self.store.types[name](**fields)

    def encode(self, message: Any) -> bytes:
        """CDR, little-endian, with its header of four bytes."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__, little_endian=True))

    def decode(self, payload: bytes, name: str) -> Any:
        """From CDR. ValueError where the bytes are no such message."""
        from rosbags.serde import SerdeError

        try:
            return self.store.deserialize_cdr(payload, name)
        except SerdeError as error:
            raise ValueError(str(error)) from None

    def hash(self, name: str) -> str:
        """The type's hash as it stands in keys."""
        if self.distro == "humble":
            return NO_HASH
        if name not in self._hashes:
            self._hashes[name] = self.store.hash_rihs01(name)
        return self._hashes[name]


def _basic(kind: str) -> Any:
    from rosbags.interfaces import Nodetype

    return (Nodetype.BASE, (kind, 0))
