"""Downloads against a local server that can drop connections, change its files and refuse."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from sips_lit.dataset_tools.download import RemoteFile, fetch, read_catalogue, remote_size
from sips_lit.errors import BadInputError

CONTENT = bytes(range(256)) * 4096  # 1 MiB


class Server:
    """What it serves, what it was asked for, and after how many bytes it drops a connection."""

    def __init__(self) -> None:
        self.content, self.tag, self.drop_after, self.ranges = CONTENT, '"v1"', None, []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_HEAD(self):
                self.send_response(200 if self.path == "/a.bin" else 404)
                self.send_header("Content-Length", str(len(outer.content)))
                self.end_headers()

            def do_GET(self):
                if self.path != "/a.bin":
                    self.send_error(404)
                    return
                wanted = self.headers.get("Range")
                outer.ranges.append(wanted)
                start = int(wanted[6:-1]) if wanted and self.headers.get("If-Range") == outer.tag else 0
                if start >= len(outer.content):
                    self.send_error(416)
                    return
                self.send_response(206 if start else 200)
                body = outer.content[start:]
                self.send_header("Content-Length", str(len(body)))
                self.send_header("ETag", outer.tag)
                self.end_headers()
                self.wfile.write(body if outer.drop_after is None else body[: outer.drop_after])

            def log_message(self, *args):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_port}/a.bin"
        threading.Thread(target=self.http.serve_forever, daemon=True).start()


@pytest.fixture
def server():
    server = Server()
    yield server
    server.http.shutdown()
    server.http.server_close()


def get(server, folder, sha256=None, attempts=2):
    return fetch(RemoteFile(server.url, len(CONTENT), sha256), folder, attempts=attempts, pause=0.0, timeout=5)


def test_a_file_is_fetched_once(server, tmp_path):
    assert remote_size(server.url) == len(CONTENT)
    assert get(server, tmp_path).read_bytes() == CONTENT
    get(server, tmp_path)
    assert len(server.ranges) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_dropped_connections_are_taken_up_where_they_ended(server, tmp_path):
    server.drop_after = 300_000
    assert get(server, tmp_path).read_bytes() == CONTENT
    assert server.ranges[:3] == [None, "bytes=300000-", "bytes=600000-"]


def test_another_run_goes_on(server, tmp_path):
    server.drop_after = 300_000
    with pytest.raises(BadInputError, match="run the command again"):
        get(server, tmp_path, attempts=1)
    assert not (tmp_path / "a.bin").exists()
    server.drop_after = None
    assert get(server, tmp_path).read_bytes() == CONTENT
    assert server.ranges[-1] == "bytes=300000-"


def test_a_file_that_changed_is_fetched_anew(server, tmp_path):
    server.drop_after = 300_000
    with pytest.raises(BadInputError):
        get(server, tmp_path, attempts=1)
    server.drop_after, server.tag, server.content = None, '"v2"', CONTENT[::-1]
    assert get(server, tmp_path).read_bytes() == CONTENT[::-1]


def test_the_checksum_is_verified(server, tmp_path):
    right = hashlib.sha256(CONTENT).hexdigest()
    assert get(server, tmp_path / "right", right).exists()
    with pytest.raises(BadInputError, match="checksum"):
        get(server, tmp_path / "wrong", "0" * 64)
    assert not list((tmp_path / "wrong").iterdir())


def test_a_server_without_progress_is_given_up(server, tmp_path):
    server.drop_after = 0
    with pytest.raises(BadInputError, match="can't be fetched"):
        get(server, tmp_path, attempts=3)
    assert len(server.ranges) == 3


def test_a_missing_file_and_a_missing_server(server, tmp_path):
    with pytest.raises(BadInputError, match="answers 404"):
        fetch(RemoteFile(server.url + "x", 1), tmp_path)
    with pytest.raises(BadInputError, match="answers 404"):
        remote_size(server.url + "x")
    with pytest.raises(BadInputError, match="can't be reached"):
        remote_size("http://127.0.0.1:9/a.bin", timeout=2)


def test_the_catalogue_says_what_a_user_needs():
    offers = read_catalogue()
    assert {"hpatches", "kitti_odometry"} <= set(offers)
    for offer in offers.values():
        assert offer.bytes > 0
        assert offer.page.startswith("http")
        assert all(file.url.startswith("http") for file in offer.files)
