"""Attacks on the server: none gets data or changes anything."""

import json
import re
from concurrent.futures import Future
from dataclasses import replace

import pytest
from reviewing import ORIGIN, PORT, TOKEN, Page, copied, review
from starlette.testclient import TestClient

from pipelines.report.write import save
from pipelines.results.store import load
from pipelines.review.answers import Office
from pipelines.review.server import MOST_BYTES, application

ASIDE = {"kind": "set_aside", "pole": {"frequency_hz": 100.3}}
EDIT = {"revision": 0, "edit": ASIDE}


@pytest.fixture(scope="module")
def server(reviewed_once, tmp_path_factory):
    """A desk with an open result, and its name."""
    folder = copied(reviewed_once, tmp_path_factory.mktemp("attacked"))
    desk = Office(folder.parent)
    yield desk, desk.name_of(folder.resolve())
    desk.close()


@pytest.fixture
def untouched(server):
    """A page whose state must be as before."""
    before = Page(*server).state()
    yield Page(*server)
    after = Page(*server).state()
    assert (after["revision"], after["edits"]) == (before["revision"], before["edits"])


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 400),
        ({"Host": f"evil.example:{PORT}"}, 400),
        ({"Host": "127.0.0.1"}, 400),
        ({"Host": f"127.0.0.1:{PORT + 1}"}, 400),
        ({"Host": f"[::1]:{PORT}"}, 400),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": f"https://127.0.0.1:{PORT}"}, 403),
        ({"Origin": "null"}, 403),
        # Rebinding: host and origin agree with each other, but not with the server.
        ({"Host": "evil.example:80", "Origin": "http://evil.example:80"}, 400),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"X-Ringmodal-Token": ""}, 401),
        ({"X-Ringmodal-Token": "0" * 64}, 401),
    ],
)
def test_foreign_requests_get_nothing(untouched, headers, status):
    for ask in ("state", "diagram", "frf"):
        answer = untouched.client.get(f"{untouched.place}/{ask}", headers=headers)
        assert answer.status_code == status
        assert set(answer.json()) == {"error"}
    answer = untouched.client.post(f"{untouched.place}/edit", json=EDIT, headers=headers)
    assert (answer.status_code, set(answer.json())) == (status, {"error"})


def bare(page, *without):
    """A client of the same server that leaves headers out."""
    for name in without:
        del page.client.headers[name]
    return page.client


def test_what_changes_anything_needs_its_origin(untouched):
    client = bare(untouched, "Origin")
    assert client.post(f"{untouched.place}/edit", json=EDIT).status_code == 403
    assert client.get(f"{untouched.place}/state").status_code == 200


def test_no_token_no_data_not_even_events(untouched):
    client = bare(untouched, "X-Ringmodal-Token")
    for place in (f"{untouched.place}/state", "/api/events", "/api/home", "/api/nothing"):
        assert client.get(place).status_code == 401


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", ""])
def test_forms_and_texts_are_refused(untouched, kind):
    headers = {"Content-Type": kind}
    answer = untouched.client.post(
        f"{untouched.place}/edit", content=json.dumps(EDIT), headers=headers
    )
    assert answer.status_code == 415


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_other_methods_are_refused(untouched, method):
    assert untouched.client.request(method, f"{untouched.place}/edit").status_code == 405


def test_pages_cannot_be_posted_to(untouched):
    assert untouched.client.post("/", json={}).status_code == 405


@pytest.mark.parametrize("size", [MOST_BYTES + 1, 10_000_000])
def test_large_bodies_are_refused(untouched, size):
    def parts():  # without a length, which would be refused at once
        for _ in range(0, size, 65536):
            yield b" " * 65536

    headers = {"Content-Type": "application/json"}
    for content in (b" " * size, parts()):
        answer = untouched.client.post(f"{untouched.place}/edit", content=content, headers=headers)
        assert answer.status_code == 413


@pytest.mark.parametrize(
    "body",
    [
        *(b"", b"[]", b"null", b"{", b"\xff", b"[" * 100_000, b'{"revision": true}'),
        *(b'{"revision": 0}', b'{"revision": "0", "edit": {}}', b'{"revision": 0, "edit": []}'),
        b'{"revision": 0, "edit": {"kind": "set_aside"}}',
        b'{"revision": 0, "edit": {"kind": "flip", "channel": ""}}',
        b'{"revision": 0, "edit": {"kind": "note", "pole": {"frequency_hz": 1}}}',
        b'{"revision": 0, "edit": {"kind": "set_aside", "pole": {"frequency_hz": NaN}}}',
        b'{"revision": 0, "edit": {"kind": "settings", "settings": {"__class__": 1}}}',
        b'{"revision": 0, "edit": {"kind": "settings", "settings": {"max_order": 100000}}}',
    ],
)
def test_senseless_edits_are_refused(untouched, body):
    headers = {"Content-Type": "application/json"}
    answer = untouched.client.post(f"{untouched.place}/edit", content=body, headers=headers)
    assert answer.status_code == 400
    assert answer.json()["error"]["remedy"]


@pytest.mark.parametrize(
    "place",
    [
        *("/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py"),
        *("/static//etc/passwd", "/static/", "/static/vendor", "/static/%00"),
        *("/api/r/..%2f..%2fetc/state", "/api/r/nope/state", "/api/w/..", "/api/compare/x"),
    ],
)
def test_paths_lead_nowhere(untouched, place):
    answer = untouched.client.get(place)
    assert answer.status_code in (400, 404)
    assert "import" not in answer.text


def test_links_out_of_the_folder_lead_nowhere(page, folder, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    folder.rename(outside / "result")
    folder.symlink_to(outside / "result")
    assert page.get("state").status_code == 404


def test_answers_forbid_foreign_content_and_framing(untouched):
    page = untouched
    for place in ("/", "/r/any", f"{page.place}/state", "/static/none"):
        headers = page.client.get(place).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert headers["cache-control"] == "no-store"
        assert "access-control-allow-origin" not in headers


def test_texts_from_files_stay_texts(reviewed_once, tmp_path):
    """A header with markup arrives as JSON text, in no page."""
    hostile = "<img src=x onerror=alert(1)>"
    folder = tmp_path / "result"
    save(replace(load(reviewed_once), name=hostile), folder, report=False)
    with review(folder) as page:
        answer = page.get("state")
        assert answer.headers["content-type"] == "application/json"
        assert answer.json()["name"] == hostile
        assert hostile not in page.client.get("/r/any").text


def test_the_page_may_be_called_localhost(server):
    local = ORIGIN.replace("127.0.0.1", "localhost")
    page = Page(*server, Origin=local)
    page.client.base_url = local
    assert page.get("state").status_code == 200


@pytest.mark.parametrize("place", ["/", "/r/any", "/compare", "/w/any"])
def test_pages_do_not_wait_for_who_answers_and_name_all_their_modules(place):
    client = TestClient(application(Future(), PORT, TOKEN), base_url=ORIGIN)
    names = set(re.findall(r"/static/(\w+\.js)", client.get(place).text))
    scripts = {name: client.get(f"/static/{name}").text for name in names}
    imported = {name for text in scripts.values() for name in re.findall(r'"\./(\w+\.js)"', text)}
    assert imported
    assert imported <= names
