"""Who may open the page."""

from __future__ import annotations

import gzip

import pytest

from services.viewer.gate import COOKIE, Gate, GateVerdict, head_of, is_this_machine, page_answer

HERE, AWAY = Gate(""), Gate("secret-token")
LOCAL, REMOTE = "127.0.0.1:8080", "cell.lab:8080"


def request(target: str = "/", host: str = LOCAL, **headers: str) -> bytes:
    lines = [f"GET {target} HTTP/1.1", f"Host: {host}", *(f"{name}: {value}" for name, value in headers.items())]
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


def socket_request(host: str, origin: str, **headers: str) -> bytes:
    return request("/", host, Upgrade="websocket", Origin=origin, **headers)


@pytest.mark.parametrize(
    ("gate", "said", "verdict"),
    [
        (HERE, request(), GateVerdict.PAGE),
        (HERE, request(host="localhost:8080"), GateVerdict.PAGE),
        (HERE, request(host="[::1]:8080"), GateVerdict.PAGE),
        (HERE, request("/assets/x.js"), GateVerdict.PASS),
        (HERE, request(host="evil.example:8080"), GateVerdict.ELSEWHERE),  # a name that was bound anew to this machine
        (HERE, socket_request(LOCAL, f"http://{LOCAL}"), GateVerdict.PASS),
        (HERE, socket_request(LOCAL, "http://evil.example"), GateVerdict.ELSEWHERE),  # a page of another site
        (HERE, socket_request(LOCAL, "null"), GateVerdict.ELSEWHERE),
        (HERE, request("/", LOCAL, Upgrade="websocket"), GateVerdict.ELSEWHERE),
        (AWAY, request(host=REMOTE), GateVerdict.NO_TOKEN),
        (AWAY, request("/?token=wrong", REMOTE), GateVerdict.NO_TOKEN),
        (AWAY, request("/?token=", REMOTE), GateVerdict.NO_TOKEN),
        (AWAY, request("/?token=secret-token", REMOTE), GateVerdict.COME_IN),
        (AWAY, request("/", REMOTE, Cookie=f"a=b; {COOKIE}=secret-token"), GateVerdict.PAGE),
        (AWAY, request("/", REMOTE, Cookie=f"{COOKIE}=secret-toke"), GateVerdict.NO_TOKEN),
        (AWAY, socket_request(REMOTE, f"http://{REMOTE}"), GateVerdict.NO_TOKEN),
        (AWAY, socket_request(REMOTE, f"http://{REMOTE}", Cookie=f"{COOKIE}=secret-token"), GateVerdict.PASS),
        (AWAY, socket_request(REMOTE, "http://evil.example", Cookie=f"{COOKIE}=secret-token"), GateVerdict.ELSEWHERE),
        (HERE, b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", GateVerdict.MALFORMED),
        (HERE, b"GET / HTTP/1.1\r\n\r\n", GateVerdict.MALFORMED),
        (HERE, b"\x16\x03\x01\x02\x00\r\n\r\n", GateVerdict.MALFORMED),
        (HERE, b"GET / HTTP/1.1\r\nno colon\r\n\r\n", GateVerdict.MALFORMED),
    ],
)
def test_who_is_let_in(gate: Gate, said: bytes, verdict: GateVerdict) -> None:
    assert gate.verdict(head_of(said)) is verdict


def test_whoever_brings_the_token_gets_a_cookie_that_no_other_site_can_use() -> None:
    answer = AWAY.answer(GateVerdict.COME_IN).decode()
    assert answer.startswith("HTTP/1.1 303") and "Location: /\r\n" in answer
    assert "HttpOnly; SameSite=Strict" in answer and f"{COOKIE}=secret-token" in answer


@pytest.mark.parametrize("verdict", [GateVerdict.NO_TOKEN, GateVerdict.ELSEWHERE, GateVerdict.MALFORMED])
def test_a_refusal_says_what_to_do_and_not_the_token(verdict: GateVerdict) -> None:
    answer = AWAY.answer(verdict)
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 40") and body and b"secret" not in answer
    assert f"Content-Length: {len(body)}".encode() in head


def test_the_page_carries_our_title_and_theme() -> None:
    head, _, body = page_answer("<html><head><script></script></head></html>", "crosspih: cell1").partition(b"\r\n\r\n")
    html = gzip.decompress(body).decode()
    assert "<title>crosspih: cell1</title>" in html and "prefers-color-scheme" in html
    assert html.index("<title>") < html.index("<script></script>") and f"Content-Length: {len(body)}".encode() in head


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.8.9.1", "::1", "localhost", "[::1]", "0.0.0.0", "::", "10.0.0.3", "x"]
)
def test_what_is_this_machine_alone(host: str) -> None:
    assert is_this_machine(host) == (host.startswith("127.") or host in ("::1", "[::1]", "localhost"))
