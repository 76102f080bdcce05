"""The refusals of the router, read from Zenoh's log, the only place where Zenoh reports them.

Links that fail their TLS handshake are logged as warnings; messages that the access rules deny are traced one by one.
Zenoh also traces what it *would* deny, once for each key that is declared. Those lines follow a line that announces
them, and report no attempt.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

# what RUST_LOG must hold for the lines below to be written
LEVELS = "error,zenoh_link_tls=warn,zenoh::net::routing::interceptor::access_control=trace"
LINK_REFUSED, ACCESS_REFUSED = "link_refused", "access_refused"
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
LINK = re.compile(r"WARN .*?zenoh_link_tls::unicast: (?P<why>.*)")
HINT = re.compile(r"\.? *Hint: .*")  # Zenoh's hint on open files, whatever the reason was
THREAD = re.compile(r"(ThreadId\(\d+\))")
CACHING = re.compile(r"ACL \((?P<flow>\w+)\): caching permissions for `(?P<key>[^`]*)`")
NAMED = re.compile(r"(?P<session>[0-9a-f]+) on \S*CertCommonName\((?P<name>[^)]*)\)")
JUDGED = re.compile(
    r"(?P<cached>Using cached result: )?(?P<session>[0-9a-f]+)(?: on \S+)? is (?P<denied>un)?authorized to "
    r"(?P<what>[^()]+) \((?P<flow>\w+)\) on (?P<key>\S+)"
)
WHY = {
    "peer sent no certificates": "it showed no certificate",
    "invalid peer certificate: UnknownIssuer": "its certificate is of another authority",
    "invalid peer certificate: BadSignature": "its certificate is of another authority",
    "invalid peer certificate: certificate expired": "its certificate has expired",
    "invalid peer certificate: certificate not valid yet": "its certificate is not valid yet",
    "received corrupt message": "it does not speak TLS",
}
# Zenoh's message types in plain words
VERBS = {
    "Put": "publish on", "Delete": "delete", "Query": "ask", "Reply": "answer for",
    "Declare Subscriber": "read", "Declare/Undeclare Subscriber": "read",
    "Declare Queryable": "serve", "Declare/Undeclare Queryable": "serve",
    "Declare Liveliness Token": "live as", "Declare/Undeclare Liveliness Token": "live as",
    "Liveliness Query": "look for", "Declare Liveliness Subscriber": "watch",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class RefusalEvent:
    """One refusal: an event code, and a sentence for people."""

    code: str
    text: str


@dataclass(slots=True)
class _WorkedOut:
    """The permissions that Zenoh computes beforehand for a key, one message type after the other."""

    flow: str
    key: str
    session: str = ""
    messages: set[str] = field(default_factory=set)

    def holds(self, judged: re.Match[str]) -> bool:
        """Whether a line belongs to them: each message type comes once, for one session."""
        if judged["cached"] or (judged["flow"], judged["key"]) != (self.flow, self.key):
            return False
        self.session = self.session or judged["session"]
        if judged["session"] != self.session or judged["what"] in self.messages:
            return False
        self.messages.add(judged["what"])
        return True


class RefusalsLog:
    """Takes Zenoh's log line by line."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}  # session: common name
        self._worked_out: dict[str, _WorkedOut] = {}  # thread: the last key

    def read(self, line: str) -> RefusalEvent | None:
        """The refusal that a line reports, or None."""
        line = COLOURS.sub("", line).rstrip()
        if (link := LINK.search(line)) is not None:
            return RefusalEvent(LINK_REFUSED, f"a connection was refused: {_reason(HINT.sub('', link['why']))}")
        for named in NAMED.finditer(line):
            self._names[named["session"]] = named["name"]
        thread = found[1] if (found := THREAD.search(line)) is not None else ""
        if (caching := CACHING.search(line)) is not None:
            self._worked_out[thread] = _WorkedOut(caching["flow"], caching["key"])
            return None
        if (judged := JUDGED.search(line)) is None:
            return None
        if (worked_out := self._worked_out.get(thread)) is not None and worked_out.holds(judged):
            return None
        if not judged["denied"] or judged["flow"] != "ingress":
            return None
        name = self._names.get(judged["session"], judged["session"])
        verb = VERBS.get(judged["what"], judged["what"].lower())
        return RefusalEvent(ACCESS_REFUSED, f"the certificate of {name} may not {verb} {judged['key']}")


def _reason(why: str) -> str:
    for begins, said in WHY.items():
        if why.startswith(begins):
            return said
    return why
