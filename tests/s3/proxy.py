"""A store between a program and another store, which does what stores and networks do on bad days."""

import collections
import http.client
import http.server
import socket
import struct
import threading
import urllib.parse


class Fault:
    """What happens to requests that `matches` chooses, the first `times` of them for each method, path and range."""

    def __init__(self, kind, times=10**9, matches=lambda request: True):
        self.kind, self.times, self.matches = kind, times, matches
        self.seen = collections.Counter()

    def hits(self, request):
        if not self.matches(request):
            return False
        key = (request.command, request.path, request.headers.get("Range"))
        self.seen[key] += 1
        return self.seen[key] <= self.times


class Server(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_):
        """Says nothing of clients that go away."""


class Proxy:
    """Listens on a port of this machine and hands on to `target`, HOST:PORT."""

    def __init__(self, target):
        self.target, self.faults, self.log, self.lock = target, [], [], threading.Lock()
        self.before = lambda request: None
        proxy = self

        class Handler(Requests):
            owner = proxy

        self.server = Server(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def reset(self, *faults, before=lambda request: None):
        """Forgets what was asked for; from now on these faults."""
        with self.lock:
            self.faults, self.log, self.before = list(faults), [], before

    def asked(self, method):
        """Paths that were asked for and answered well, without what follows a question mark, in their order."""
        return [path.split("?")[0] for command, path, status in self.log if command == method and status < 300]


class Requests(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    owner = None

    def log_message(self, *_):
        pass

    def handle_any(self):
        body = self.body()
        with self.owner.lock:
            self.owner.before(self)
            kinds = [fault.kind for fault in self.owner.faults if fault.hits(self)]
        plain = {"503": (503, "SlowDown"), "429": (429, "TooManyRequests"), "403": (403, "SignatureDoesNotMatch")}
        for kind in kinds:
            if kind in plain:
                return self.refuse(*plain[kind])
        if "reset" in kinds:
            return self.break_off()
        headers = {key: value for key, value in self.headers.items() if key.lower() != "connection"}
        if "no conditions" in kinds:
            headers = {key: value for key, value in headers.items() if not key.lower().startswith("if-")}
        target = http.client.HTTPConnection(self.owner.target, timeout=60)
        target.request(self.command, self.path, body=body, headers=headers)
        answer = target.getresponse()
        data = answer.read()
        self.owner.log.append((self.command, self.path, answer.status))
        if "lost answer" in kinds:
            return self.break_off()
        self.hand_on(answer, data, kinds)
        target.close()

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = handle_any

    def body(self):
        length = self.headers.get("Content-Length")
        if length is not None:
            return self.rfile.read(int(length))
        assert self.headers.get("Transfer-Encoding") is None, "no chunks are expected"
        return None

    def refuse(self, status, code):
        # as stores do, the answer repeats the key of whoever asked
        key = self.headers.get("Authorization", "").partition("Credential=")[2].partition("/")[0]
        text = (
            f"<?xml version='1.0'?><Error><Code>{code}</Code><Message>not now, {key}</Message>"
            f"<AWSAccessKeyId>{key}</AWSAccessKeyId><StringToSign>AWS4 {key}</StringToSign></Error>"
        )
        data = b"" if self.command == "HEAD" else text.encode()
        self.owner.log.append((self.command, self.path, status))
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def break_off(self, data=b""):
        self.wfile.write(data)
        self.wfile.flush()
        # closes with a reset
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.connection.close()
        self.close_connection = True

    def hand_on(self, answer, data, kinds):
        short = "short" in kinds and len(data) > 8 and self.command == "GET"
        cut = "cut" in kinds and len(data) > 8 and self.command == "GET"
        sent = data[: len(data) // 2] if short or cut else data
        head = [f"HTTP/1.1 {answer.status} {answer.reason}"]
        for key, value in answer.getheaders():
            if key.lower() in ["connection", "transfer-encoding", "keep-alive", "content-length"]:
                continue
            head.append(f"{key}: {value}")
        length = answer.getheader("Content-Length") if self.command == "HEAD" else len(sent if short else data)
        head += [f"Content-Length: {length or 0}", "", ""]
        text = "\r\n".join(head).encode("latin-1")
        if cut:
            return self.break_off(text + sent)
        self.wfile.write(text + (b"" if self.command == "HEAD" else sent))


def key_of(path, bucket):
    """The key that a path of a request names."""
    return urllib.parse.unquote(path.split("?")[0]).removeprefix(f"/{bucket}/")
