//! The head of a request and the answers to it. No I/O: bytes in, bytes out.

use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

/// Longest head, bytes.
pub(super) const HEAD_BYTES: usize = 8192;
/// Most header lines: a browser sends some twenty.
const HEADERS: usize = 64;

/// What of a request matters here.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Request {
    pub method: String,
    /// Without what stands behind `?`.
    pub path: String,
    /// What stands there.
    pub query: String,
    pub host: Option<String>,
    pub origin: Option<String>,
    /// `Sec-WebSocket-Key` of a request to upgrade.
    pub websocket_key: Option<String>,
    /// Sub-protocols that the client speaks.
    pub protocols: Vec<String>,
    /// `Authorization: Bearer …`.
    pub bearer: Option<String>,
}

impl Request {
    /// A value of the query, as it stands there.
    pub(super) fn query(&self, name: &str) -> Option<&str> {
        let pairs = self.query.split('&').filter_map(|pair| pair.split_once('='));
        pairs.into_iter().find(|(n, _)| *n == name).map(|(_, value)| value)
    }
}

/// What came so far.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Head {
    /// A request, and how many bytes it took.
    Whole(Box<Request>, usize),
    /// The rest is still on its way.
    Partial,
    /// Not HTTP.
    Garbage,
}

/// Reads the head of a request.
pub(super) fn parse(bytes: &[u8]) -> Head {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let length = match parsed.parse(bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) if bytes.len() < HEAD_BYTES => return Head::Partial,
        Ok(httparse::Status::Partial) | Err(_) => return Head::Garbage,
    };
    let target = parsed.path.unwrap_or("/");
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let mut request = Request {
        method: parsed.method.unwrap_or_default().to_owned(),
        path: path.to_owned(),
        query: query.to_owned(),
        ..Request::default()
    };
    let mut upgrades = false;
    for header in parsed.headers.iter() {
        // A header with bytes that are no text is none that we look for.
        let Ok(value) = std::str::from_utf8(header.value) else { continue };
        let value = value.trim();
        match header.name.to_ascii_lowercase().as_str() {
            // Two of them are an attempt at something.
            "host" if request.host.is_some() => return Head::Garbage,
            "host" => request.host = Some(value.to_ascii_lowercase()),
            "origin" => request.origin = Some(value.to_ascii_lowercase()),
            "upgrade" => upgrades = value.eq_ignore_ascii_case("websocket"),
            "sec-websocket-key" => request.websocket_key = Some(value.to_owned()),
            "sec-websocket-protocol" => {
                request.protocols.extend(value.split(',').map(|p| p.trim().to_owned()));
            }
            "authorization" => {
                request.bearer = value.strip_prefix("Bearer ").map(|token| token.trim().to_owned());
            }
            _ => {}
        }
    }
    if !upgrades {
        request.websocket_key = None;
    }
    Head::Whole(Box::new(request), length)
}

/// Sent with every answer: nothing from elsewhere is loaded, nobody frames us, no address leaks.
const GUARDS: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n";

/// An answer with a body, after which the connection ends.
pub(super) fn answer(status: &str, kind: &str, body: &str, with_body: bool) -> Vec<u8> {
    let mut text = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\n\
         Connection: close\r\n{GUARDS}\r\n",
        body.len()
    );
    if with_body {
        text.push_str(body);
    }
    text.into_bytes()
}

/// The answer that makes a connection a WebSocket.
pub(super) fn upgrade(key: &str, protocol: Option<&str>) -> Vec<u8> {
    let accept = derive_accept_key(key.as_bytes());
    let protocol = protocol.map(|p| format!("Sec-WebSocket-Protocol: {p}\r\n")).unwrap_or_default();
    format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {accept}\r\n{protocol}\r\n"
    )
    .into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPGRADE: &str = "GET /live?token=abc&x=1 HTTP/1.1\r\nHost: LocalHost:8480\r\n\
        Upgrade: websocket\r\nConnection: keep-alive, Upgrade\r\nOrigin: http://localhost:8480\r\n\
        Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
        Sec-WebSocket-Protocol: a, foxglove.websocket.v1\r\n\r\n";

    #[test]
    fn val_the_upgrade_is_that_of_rfc_6455() {
        let Head::Whole(request, length) = parse(UPGRADE.as_bytes()) else { panic!() };
        assert_eq!(length, UPGRADE.len());
        assert_eq!((request.path.as_str(), request.query("token")), ("/live", Some("abc")));
        assert_eq!(request.host.as_deref(), Some("localhost:8480"));
        assert_eq!(request.protocols, ["a", "foxglove.websocket.v1"]);
        let key = request.websocket_key.unwrap();
        let answer = String::from_utf8(upgrade(&key, Some("foxglove.websocket.v1"))).unwrap();
        // RFC 6455, section 1.3: this key has this answer.
        assert!(
            answer.contains("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"),
            "{answer}"
        );
        assert!(answer.contains("Sec-WebSocket-Protocol: foxglove.websocket.v1\r\n"));
    }

    #[test]
    fn prop_a_head_in_pieces_is_awaited_and_garbage_is_told_apart() {
        for cut in 0..UPGRADE.len() {
            assert_eq!(parse(&UPGRADE.as_bytes()[..cut]), Head::Partial, "{cut}");
        }
        for garbage in [&b"\x16\x03\x01\x02\x00\x01"[..], &[0xfd; 300], b"GET / HTTP/9\r\n\r\n"] {
            assert_eq!(parse(garbage), Head::Garbage, "{garbage:?}");
        }
        assert_eq!(parse(&[b'A'; HEAD_BYTES]), Head::Garbage);
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(100));
        assert_eq!(parse(many.as_bytes()), Head::Garbage);
        let twice = "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n";
        assert_eq!(parse(twice.as_bytes()), Head::Garbage);
    }
}
