"""Bytes and back: pydantic JSON for messages, Foxglove protobuf for images, and a label that names type and version."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import ValidationError

from crosspih_common.errors import CommandRefused, ContractError
from crosspih_common.messages.base import Message
from crosspih_common.messages.images import ENCODINGS, IMAGE_TYPE, Image, Pixels
from crosspih_common.messages.status import MAX_TEXT
from crosspih_common.plain_text import is_plain_json, plain

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from crosspih_common.keys import Payload

PayloadT = TypeVar("PayloadT", bound="Payload")

SEQ_DIGITS = 16  # below 2**53: exact in every language's JSON
_HEAD = b'{"stamp_ns":%d,"seq":%d'
_UNSTAMPED = _HEAD % (-1, -1)
_UNNUMBERED = b'"seq":-1'
MAX_BYTES = 4_000_000
MAX_IMAGE_BYTES = 64_000_000  # 2448 x 2048 in three colours is 15 MB


_labels: dict[type[Any], str] = {}
_decoders: dict[type[Any], Callable[[bytes, str, str], Any]] = {}


def label_of(kind: type[Any]) -> str:
    """The label that is sent with the payload: type name, slash, version. Raises TypeError for any other type."""
    label = _labels.get(kind)
    if label is None:
        label = _labels[kind] = _made_label(kind)
    return label


def _made_label(kind: type[Any]) -> str:
    if issubclass(kind, Image):
        return f"{IMAGE_TYPE}/1"
    if issubclass(kind, Message):
        return f"{kind.type_name()}/{kind.VERSION}"
    raise TypeError(f"{kind.__name__} does not travel on the bus")


def encode(value: Payload) -> bytes:
    """The payload's bytes."""
    if isinstance(value, Image):
        return _encode_image(value)
    return value.__pydantic_serializer__.to_json(value)


def encode_stamped(value: Message, stamp_ns: int, seq: int) -> bytes:
    """The message's bytes with this stamp and number in place of its own; the message is neither changed nor copied.

    The JSON of every message begins with these two fields (tests/common/test_messages.py).
    """
    payload = value.__pydantic_serializer__.to_json(value)
    own = _HEAD % (value.stamp_ns, value.seq)
    if not payload.startswith(own):
        raise TypeError(f"{type(value).__name__}: does not begin with stamp_ns and seq, as every message must")
    return _HEAD % (stamp_ns, seq) + payload[len(own) :]


def stamper_of(kind: type[Any]) -> Callable[[Any, int, int], bytes]:
    """`encode_stamped` for one type, images included. A publisher calls the result for each sample, so it is kept
    minimal."""
    if issubclass(kind, Image):
        return lambda image, stamp_ns, seq: encode(Image(image.frame, image.pixels, stamp_ns, seq, image.encoding))
    to_json = kind.__pydantic_serializer__.to_json

    def stamped(value: Any, stamp_ns: int, seq: int) -> bytes:
        if type(value) is not kind or value.seq != -1:
            return encode_stamped(value, stamp_ns, seq)
        payload: bytes = to_json(value)
        if value.stamp_ns == stamp_ns:
            return payload.replace(_UNNUMBERED, b'"seq":%d' % seq, 1)  # the first one is its own
        if payload.startswith(_UNSTAMPED):
            return _HEAD % (stamp_ns, seq) + payload[len(_UNSTAMPED) :]
        return encode_stamped(value, stamp_ns, seq)

    # decided once per type, not for each sample
    begun = encode_stamped if list(kind.model_fields)[:2] != ["stamp_ns", "seq"] else stamped
    return begun


def label_with_seq(kind: type[Any], seq: int) -> str:
    """The label of one sample: type, version and the publisher's count."""
    return f"{label_of(kind)} {seq}"


def split_label(label: str) -> tuple[str, int]:
    """(type/version, seq) of a label; seq is -1 where the label has none, or one that no publisher can reach."""
    name, _, number = label.partition(" ")
    return name, number_of(number)


def number_of(text: str) -> int:
    """The number in a label; -1 for a text that is no number, or a number that no publisher can reach."""
    return int(text) if len(text) <= SEQ_DIGITS and text.isascii() and text.isdigit() else -1


def most_bytes(kind: type[Any]) -> int:
    """The size beyond which a payload of this type is refused before anything of it is read."""
    return MAX_IMAGE_BYTES if issubclass(kind, Image) else MAX_BYTES


def _too_large(payload: bytes, most: int, key: str) -> str:
    return f"{key}: got {len(payload)} bytes, {most} are allowed"


def decode(kind: type[PayloadT], payload: bytes, label: str, key: str) -> PayloadT:
    """The message of a payload. Raises ContractError with both names on any mismatch."""
    decoded: PayloadT = decoder_of(kind)(payload, label, key)
    return decoded


def decoder_of(kind: type[Any]) -> Callable[[bytes, str, str], Any]:
    """`decode` for one type, called with (payload, label, key); work that is the same for all samples is done once."""
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = _made_decoder(kind)
    return decoder


def validator_without_text(kind: type[Any]) -> Callable[[bytes], Any] | None:
    """pydantic-core's validator of a type without text fields: its messages need no check of their strings. None for
    other types."""
    if issubclass(kind, Image) or not _is_textless(kind.__pydantic_core_schema__):
        return None
    validate: Callable[[bytes], Any] = kind.__pydantic_validator__.validate_json
    return validate


_TEXTLESS = frozenset(
    {"bool", "default", "definition-ref", "definitions", "enum", "float", "function-after", "int", "list", "literal"}
    | {"model", "model-field", "model-fields", "nullable", "tuple"}
)

_NO_SCHEMAS = frozenset({"config", "function", "metadata", "serialization"})


def _is_textless(schema: Any) -> bool:
    """Whether a part of a core schema holds only types without free text."""
    if isinstance(schema, dict):
        if isinstance(kind := schema.get("type"), str) and kind not in _TEXTLESS:
            return False
        schema = [part for name, part in schema.items() if name not in _NO_SCHEMAS]
    return not isinstance(schema, list) or all(map(_is_textless, schema))


def _made_decoder(kind: type[Any]) -> Callable[[bytes, str, str], Any]:
    expected, most, is_image = label_of(kind), most_bytes(kind), issubclass(kind, Image)
    counted = f"{expected} "
    validate = None if is_image else kind.__pydantic_validator__.validate_json

    def decode_one(payload: bytes, label: str, key: str) -> Any:
        if not label.startswith(counted) and label != expected:
            name = split_label(label)[0]
            raise ContractError(
                f"{key}: got {name[:80] or 'no type name'}, want {expected}; run the same crosspih on both ends"
            )
        if len(payload) > most:
            raise ContractError(_too_large(payload, most, key))
        if validate is None:
            return _decode_image(payload, split_label(label)[1])
        try:
            value = validate(payload)
        except ValidationError as error:
            raise ContractError(why_invalid(error, expected, key)) from None
        if not is_plain_json(payload):
            raise ContractError(f"{key}: a text of it holds control characters, which a terminal would obey")
        return value

    return decode_one


def why_invalid(error: ValidationError, expected: str, key: str) -> str:
    """What is wrong with a payload, field by field, for people."""
    problems = "; ".join(_problem(problem) for problem in error.errors()[:4])
    return f"{key}: does not validate as {expected}: {problems}"


def _problem(problem: ErrorDetails) -> str:
    """One problem, shortened: the name of an unknown field is chosen by the sender and can have any length."""
    where = ".".join(str(part)[:80] for part in problem["loc"])
    return f"{plain(where, 200) or 'payload'}: {plain(problem['msg'], 400)}"


def encode_refusal(refusal: CommandRefused) -> bytes:
    """A refusal's bytes: code, newline, text."""
    return f"{refusal.code}\n{refusal.text}".encode()


def decode_refusal(payload: bytes) -> CommandRefused:
    """The refusal in an error reply's bytes."""
    code, _, text = payload.decode(errors="replace").partition("\n")
    code = plain(code, 80)
    return CommandRefused(code or "unknown", plain(text, MAX_TEXT))


def _raw_image() -> Any:
    # imported only for an image: most services never handle one and need no protobuf
    from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

    return RawImage


def _encode_image(image: Image) -> bytes:
    message = _raw_image()()
    message.timestamp.FromNanoseconds(max(image.stamp_ns, 0))
    message.frame_id = image.frame
    message.height, message.width = image.pixels.shape[:2]
    message.encoding = image.encoding
    kind, channels = ENCODINGS[image.encoding]
    message.step = image.pixels.shape[1] * channels * np.dtype(kind).itemsize
    message.data = np.ascontiguousarray(image.pixels, dtype=kind).tobytes()
    return bytes(message.SerializeToString())


def _decode_image(payload: bytes, seq: int) -> Image:
    from google.protobuf.message import DecodeError

    message = _raw_image()()
    try:
        message.ParseFromString(payload)
        kind, channels = ENCODINGS[message.encoding]
        sample = np.dtype(kind)
        row, step = message.width * channels * sample.itemsize, message.step
        if step < row or len(message.data) != step * message.height:
            raise ValueError(
                f"step {step} and {len(message.data)} bytes of data do not fit {message.height} rows of {row} bytes"
            )
        shape = (message.height, message.width) if channels == 1 else (message.height, message.width, 3)
        # a driver may pad its rows to a multiple of some bytes
        rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, step)[:, :row]
        if sample.itemsize == 1:
            pixels: Pixels = rows.reshape(shape)
        else:
            pixels = np.ascontiguousarray(rows).view(sample).astype(np.uint16).reshape(shape)
        encoding = "mono16" if message.encoding == "mono16be" else message.encoding
    except (DecodeError, KeyError, ValueError) as error:
        raise ContractError(
            f"{IMAGE_TYPE}: is not an image that crosspih reads ({', '.join(ENCODINGS)}): {error}"
        ) from None
    return Image(message.frame_id, pixels, message.timestamp.ToNanoseconds(), seq, encoding)
