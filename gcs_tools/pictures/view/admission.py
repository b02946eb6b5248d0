"""Who gets the page of `gcs view`: whoever opens the link that it prints, and nobody's other page.

Any page that a browser shows may connect to this machine, and a name may be made to lead here (DNS
rebinding). So each request must name this server as its host, a WebSocket must come from this
server's own page, and page and WebSocket need the secret of the link. The first request brings it;
its answer moves it into a cookie that scripts cannot read, and leads to an address without it. So
the secret is in no Referer, and a page that is loaded again still has it.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

NAMES = ("127.0.0.1", "localhost")  # by which a browser may call this machine
SAYS_NO = b"Open the link that gcs view has printed: it holds a secret that this page needs.\n"
GUARDED = {
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}

Answer = Callable[[Any, Request], Response | None]


def new_secret() -> str:
    """Unguessable, and of letters that an address may hold."""
    return secrets.token_urlsafe(32)


class Admission:
    """Looks at the requests of one server, before the server does."""

    def __init__(self, port: int, secret: str) -> None:
        self._secret = secret.encode()
        self._cookie = f"gcs_view_{port}"  # cookies of a machine's ports are all in one place
        self._hosts = {f"{name}:{port}" for name in NAMES}
        self._installed = False

    def look(self, request: Request) -> Response | None:
        """The answer to a request that the server must not see; None: let it see that."""
        if not self._is_one_of(request, "Host", self._hosts):
            return _told(HTTPStatus.FORBIDDEN, SAYS_NO)
        place = urlsplit(request.path)
        is_upgrade = "Upgrade" in request.headers
        if place.path == "/" and not is_upgrade and (given := parse_qs(place.query).get("token")):
            return (
                self._led_on()
                if self._is_secret(given[0])
                else _told(HTTPStatus.FORBIDDEN, SAYS_NO)
            )
        if is_upgrade and not self._is_one_of(
            request, "Origin", {f"http://{host}" for host in self._hosts}
        ):
            return _told(HTTPStatus.FORBIDDEN, SAYS_NO)
        # the program of the page is no secret, and a browser asks for parts of it without cookies
        if (is_upgrade or place.path == "/") and not self._has_secret(request):
            return _told(HTTPStatus.FORBIDDEN, SAYS_NO)
        return None

    @staticmethod
    def _is_one_of(request: Request, name: str, allowed: set[str]) -> bool:
        given = request.headers.get_all(name)
        return len(given) == 1 and given[0].lower() in allowed

    def _is_secret(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._secret)

    def _has_secret(self, request: Request) -> bool:
        for line in request.headers.get_all("Cookie"):
            try:
                found = SimpleCookie(line).get(self._cookie)
            except CookieError:
                continue
            if found is not None and self._is_secret(found.value):
                return True
        return False

    def _led_on(self) -> Response:
        answer = _told(HTTPStatus.SEE_OTHER, b"")
        answer.headers["Location"] = "/"
        # Lax: a link that another program shows leads here too; a WebSocket of another's page not
        answer.headers["Set-Cookie"] = (
            f"{self._cookie}={self._secret.decode()}; HttpOnly; SameSite=Lax; Path=/"
        )
        return answer

    def before(self, serves: Answer) -> Answer:
        """What answers a request: this first, and then `serves`."""

        def answer(connection: Any, request: Request) -> Response | None:
            refused = self.look(request)
            if refused is not None:
                return refused
            response = serves(connection, request)
            if response is not None:
                response.headers.update(GUARDED)
            return response

        return answer

    @contextmanager
    def installed(self) -> Iterator[None]:
        """A server of viser that is begun within the block answers nobody without being asked here.

        viser has no way to be told so. Raises RuntimeError if none was begun that could be.
        """
        serve = websockets.asyncio.server.serve

        def guarded(*arguments: Any, process_request: Answer, **options: Any) -> Any:
            self._installed = True
            return serve(*arguments, process_request=self.before(process_request), **options)

        websockets.asyncio.server.serve = guarded  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
        if not self._installed:
            raise RuntimeError("this version of viser serves without asking who is there")


def _told(status: HTTPStatus, body: bytes) -> Response:
    headers = Headers(
        {"Content-Type": "text/plain", "Content-Length": str(len(body)), "Connection": "close"}
        | GUARDED
    )
    headers["Cache-Control"] = "no-store"
    return Response(status, status.phrase, headers, body)
