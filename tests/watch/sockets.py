"""A WebSocket client of a few lines (RFC 6455), so that what comes is seen as it is."""

import base64
import hashlib
import json
import os
import socket
import struct
import time

GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


class Refused(Exception):
    """The server did not upgrade; `status` says how it answered."""

    def __init__(self, status, body):
        super().__init__(f"{status}: {body}")
        self.status = status


def http(port, request, seconds=5.0, host="127.0.0.1"):
    """Sends bytes, gives all that comes until the connection ends."""
    with socket.create_connection((host, port), seconds) as s:
        s.settimeout(seconds)
        s.sendall(request)
        answer = b""
        while True:
            try:
                more = s.recv(65536)
            except ConnectionResetError:
                return answer
            if not more:
                return answer
            answer += more


def get(port, path="/", **headers):
    lines = [f"GET {path} HTTP/1.1", *(f"{k}: {v}" for k, v in {"Host": f"127.0.0.1:{port}", **headers}.items())]
    head, _, body = http(port, ("\r\n".join(lines) + "\r\n\r\n").encode()).partition(b"\r\n\r\n")
    return int(head.split()[1]), head.decode(), body.decode()


class WebSocket:
    def __init__(self, port, path="/live", host=None, origin=None, protocols=(), seconds=5.0,
                 address="127.0.0.1"):
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {host or f'{address}:{port}'}", "Upgrade: websocket",
                 "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
        if origin:
            lines.append(f"Origin: {origin}")
        if protocols:
            lines.append("Sec-WebSocket-Protocol: " + ", ".join(protocols))
        self.socket = socket.create_connection((address, port), seconds)
        self.socket.settimeout(seconds)
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.buffer = b""
        while b"\r\n\r\n" not in self.buffer:
            more = self.socket.recv(4096)
            if not more:
                raise Refused(0, "closed")
            self.buffer += more
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        status = int(head.split()[1])
        if status != 101:
            raise Refused(status, self.buffer.decode(errors="replace"))
        headers = dict(line.split(": ", 1) for line in head.decode().split("\r\n")[1:])
        accept = base64.b64encode(hashlib.sha1((key + GUID).encode()).digest()).decode()
        assert headers["Sec-WebSocket-Accept"] == accept
        self.protocol = headers.get("Sec-WebSocket-Protocol")

    def read(self, n):
        while len(self.buffer) < n:
            more = self.socket.recv(65536)
            if not more:
                raise EOFError("the server ended the connection")
            self.buffer += more
        piece, self.buffer = self.buffer[:n], self.buffer[n:]
        return piece

    def receive(self):
        """The next message: text as str, binary as bytes."""
        whole = b""
        while True:
            first, second = self.read(2)
            assert not second & 0x80, "a server does not mask"
            length = second & 0x7F
            if length == 126:
                length = struct.unpack(">H", self.read(2))[0]
            elif length == 127:
                length = struct.unpack(">Q", self.read(8))[0]
            payload, opcode = self.read(length), first & 0x0F
            if opcode == 8:
                raise EOFError(f"closed by the server: {payload!r}")
            if opcode in (9, 10):
                continue
            kind = opcode or kind  # noqa: F821 - 0 goes on with the kind of the first piece
            whole += payload
            if first & 0x80:
                return whole.decode() if kind == 1 else whole

    def wait(self, holds, seconds=10.0):
        """The next JSON message that fits."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            message = self.receive()
            if isinstance(message, str) and message.startswith("{"):
                message = json.loads(message)
                if holds(message):
                    return message
        raise AssertionError(f"not within {seconds} s")

    def send(self, message, opcode=None):
        data = message.encode() if isinstance(message, str) else message
        mask = os.urandom(4)
        n = len(data)
        length = bytes([0x80 | n]) if n < 126 else (
            b"\xfe" + struct.pack(">H", n) if n < 65536 else b"\xff" + struct.pack(">Q", n))
        kind = opcode if opcode is not None else (1 if isinstance(message, str) else 2)
        masked = bytes(b ^ mask[i % 4] for i, b in enumerate(data))
        self.socket.sendall(bytes([0x80 | kind]) + length + mask + masked)

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
