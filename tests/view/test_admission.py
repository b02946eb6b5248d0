"""Who gets the page and its WebSocket: whoever has the link, from the page itself."""

from __future__ import annotations

import re
import socket
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.view import admission
from gcs_tools.pictures.view.app import App, NoPort, on_free_port
from gcs_tools.recording.schema import TOPICS


class Led(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_arguments):
        return None


@pytest.fixture(scope="module")
def flight():
    return FlightHistory("under test", {name: topic.columns for name, topic in TOPICS.items()})


@pytest.fixture(scope="module")
def app(flight):
    made = []
    on_free_port(None, 8300, lambda port: made.append(App(flight, port, whole=False)))
    (shown,) = made
    yield shown
    shown.stop()


@pytest.fixture(scope="module")
def page(app):
    """Scheme, host and port of the page."""
    return app.url.partition("/?")[0]


def get(url, **headers):
    """Status, headers and body, without following."""
    asked = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.build_opener(Led).open(asked) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


@pytest.fixture(scope="module")
def cookie(app):
    return get(app.url)[1]["Set-Cookie"].partition(";")[0]


def refused(page, headers, **options):
    with pytest.raises(InvalidStatus) as found, opened(page, headers, **options):
        pass
    return found.value.response.status_code


def opened(page, headers, **options):
    protocol = f"viser-v{viser.__version__}"
    return connect(
        page.replace("http:", "ws:"), subprotocols=[protocol], additional_headers=headers,
        proxy=None, **{"origin": page, **options},
    )  # fmt: skip


def test_the_link_sets_a_cookie_and_leads_to_an_address_without_its_secret(app, page, cookie):
    status, headers, body = get(app.url)
    assert (status, headers["Location"], body) == (303, "/", b"")
    assert {"HttpOnly", "SameSite=Lax"} <= set(re.split("; *", headers["Set-Cookie"]))
    status, headers, body = get(f"{page}/", Cookie=cookie)
    assert status == 200
    assert b"<html" in body
    assert (headers["Referrer-Policy"], headers["X-Frame-Options"]) == ("no-referrer", "DENY")


def test_the_own_page_gets_the_websocket(page, cookie):
    with opened(page, {"Cookie": f"other=1; {cookie}"}) as socket:
        assert socket.recv(timeout=10.0)


@pytest.mark.parametrize(
    "cookies", [{}, {"Cookie": "gcs_view=x"}, {"Cookie": "gcs_view_{port}=x"},
                {"Cookie": "gcs_view_{port}=\u00e9"}, {"Cookie": "=;=;"}],
)  # fmt: skip
def test_without_the_secret_there_is_neither_page_nor_websocket(page, cookies):
    cookies = {k: v.replace("{port}", str(urlsplit(page).port)) for k, v in cookies.items()}
    assert refused(page, cookies) == 403
    assert get(f"{page}/", **cookies)[0] == 403
    assert get(f"{page}/?token=x")[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "https://127.0.0.1:{port}", "null",
                                    "http://127.0.0.1:1", None])  # fmt: skip
def test_another_page_gets_no_websocket_though_the_browser_has_the_cookie(page, cookie, origin):
    origin = origin and origin.replace("{port}", str(urlsplit(page).port))
    assert refused(page, {"Cookie": cookie}, origin=origin) == 403


def _raw(page, *lines):
    """The status line of the answer to a request of these lines."""
    place = urlsplit(page)
    with socket.create_connection((place.hostname, place.port)) as link:
        link.sendall("\r\n".join([*lines, "", ""]).encode())
        return link.recv(4096).split(b"\r\n")[0].decode()


@pytest.mark.parametrize("host", ["evil.example:{port}", "127.0.0.1", "127.0.0.1:1"])
@pytest.mark.parametrize("upgrade", ["websocket", "WebSocket"])
def test_a_name_that_was_made_to_lead_here_is_refused(page, cookie, host, upgrade):
    port = urlsplit(page).port
    host = host.replace("{port}", str(port))
    plain = ("GET / HTTP/1.1", f"Host: {host}", f"Cookie: {cookie}")
    socketed = (
        *plain, f"Origin: http://{host}", f"Upgrade: {upgrade}", "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13",
    )  # fmt: skip
    assert " 403 " in _raw(page, *plain)
    assert " 403 " in _raw(page, *socketed)
    assert " 403 " in _raw(page, *plain, f"Host: 127.0.0.1:{port}")  # two names


def test_a_page_of_a_server_that_cannot_be_guarded_is_not_served():
    with pytest.raises(RuntimeError), admission.Admission(1, "x").installed():
        pass


def test_secrets_are_compared_in_constant_time(page, cookie, monkeypatch):
    seen = []
    compare = admission.hmac.compare_digest
    monkeypatch.setattr(
        admission.hmac, "compare_digest", lambda a, b: seen.append(a) or compare(a, b)
    )
    get(f"{page}/", Cookie=cookie)
    get(f"{page}/?token=guess")
    assert seen == [cookie.partition("=")[2].encode(), b"guess"]


def test_the_link_works_in_a_browser_and_the_page_when_loaded_again(app, page, look):
    shown = look(app.url).page
    assert shown.url == f"{page}/"
    shown.reload()
    shown.wait_for_function(
        "window.__viserMutable?.nodeRefFromName?.['/world/vehicle/disc_8'] != null"
    )
    assert "gcs_view" not in shown.evaluate("document.cookie")


def test_the_secret_is_in_no_log_and_no_referer(recording, gcs_view):
    started = gcs_view(recording.path)
    secret = urlsplit(started.url).query.partition("=")[2]
    assert len(secret) >= 32
    get(started.url.replace(secret, "guess"))
    get(started.url)
    started.process.terminate()
    out, err = started.process.communicate()
    assert secret not in out + err
    assert "Traceback" not in err


def test_a_port_that_is_taken_after_the_look_is_passed_over(flight):
    """Two programs that begin at once find the same free port."""
    others, shown = [], []

    def show(port):
        if not others:
            others.append(socket.create_server(("127.0.0.1", port)))
        with App(flight, port, whole=False) as app:
            shown.append(urlsplit(app.url).port)

    try:
        on_free_port(None, 8400, show)
        taken = others[0].getsockname()[1]
        assert shown[0] > taken
        with pytest.raises(NoPort):
            on_free_port(taken, 8400, show)
    finally:
        for other in others:
            other.close()
