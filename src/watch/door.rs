//! Who may look: the token, and whose page it is that connects.
//!
//! A page of any site can make the browser of somebody in the lab connect to an address in the lab. The
//! browser then says whose page it is (`Origin`) and what it takes the address for (`Host`): a name that
//! was made to point here is not ours.

use std::net::IpAddr;

use super::http::Request;
use crate::watch::token::Token;

/// Why somebody is turned away: status line and sentence.
pub(super) type Refusal = (&'static str, &'static str);

/// The conditions.
#[derive(Debug)]
pub(super) struct Door {
    token: Option<Token>,
    origins: Vec<String>,
}

impl Door {
    pub(super) fn new(token: Option<Token>, origins: &[String]) -> Self {
        let origins =
            origins.iter().map(|o| o.trim_end_matches('/').to_ascii_lowercase()).collect();
        Self { token, origins }
    }

    /// What people add to the address.
    pub(super) fn hint(&self) -> &'static str {
        if self.token.is_some() { "#token=… (the content of watch.token_file)" } else { "" }
    }

    /// Whether a connection may become a WebSocket.
    pub(super) fn admit(&self, request: &Request) -> Result<(), Refusal> {
        let host = request.host.as_deref().unwrap_or_default();
        if self.token.is_none() && !is_loopback(host) {
            return Err((
                "421 Misdirected Request",
                "without a token only as localhost or 127.0.0.1\n",
            ));
        }
        if let Some(origin) = &request.origin {
            let own = origin.strip_prefix("http://") == Some(host);
            if !own && !self.origins.contains(origin) {
                return Err(("403 Forbidden", "this site is not in watch.origins\n"));
            }
        }
        match &self.token {
            None => Ok(()),
            Some(token) => {
                let shown =
                    request.query("token").or(request.bearer.as_deref()).unwrap_or_default();
                if token.is(shown) {
                    Ok(())
                } else {
                    Err(("401 Unauthorized", "the token is missing or wrong\n"))
                }
            }
        }
    }
}

/// Whether a `Host` can only mean this computer.
fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "localhost" || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(host: &str, origin: &str, query: &str) -> Request {
        Request {
            host: Some(host.into()),
            origin: (!origin.is_empty()).then(|| origin.into()),
            query: query.into(),
            ..Request::default()
        }
    }

    #[test]
    fn prop_without_a_token_only_this_computer_by_its_own_name() {
        let door = Door::new(None, &[]);
        let status = |host: &str, origin: &str| {
            door.admit(&request(host, origin, "")).map_err(|(status, _)| &status[..3])
        };
        for host in ["localhost:8480", "127.0.0.1:8480", "[::1]:8480", "localhost"] {
            assert_eq!(status(host, ""), Ok(()), "{host}");
            assert_eq!(status(host, &format!("http://{host}")), Ok(()), "{host}");
            assert_eq!(status(host, "http://evil.example"), Err("403"), "{host}");
            assert_eq!(status(host, "null"), Err("403"), "{host}");
        }
        // A name that somebody made to point here, and none at all.
        for host in ["evil.example:8480", "", "localhost.evil.example", "127.0.0.1.evil.example"] {
            assert_eq!(status(host, &format!("http://{host}")), Err("421"), "{host}");
        }
        // The same host on another port is another site.
        assert_eq!(status("localhost:8480", "http://localhost:3000"), Err("403"));
    }

    #[test]
    fn prop_with_a_token_whoever_shows_it_from_our_page_or_a_named_site() {
        let token = Token::new("0123456789abcdef").unwrap();
        let door = Door::new(Some(token), &["https://App.foxglove.dev/".into()]);
        let status = |host: &str, origin: &str, query: &str| {
            door.admit(&request(host, origin, query)).map_err(|(status, _)| &status[..3])
        };
        let good = "token=0123456789abcdef";
        assert_eq!(status("10.0.0.7:8480", "http://10.0.0.7:8480", good), Ok(()));
        assert_eq!(status("10.0.0.7:8480", "", good), Ok(()));
        assert_eq!(status("10.0.0.7:8480", "https://app.foxglove.dev", good), Ok(()));
        assert_eq!(status("10.0.0.7:8480", "https://evil.example", good), Err("403"));
        for wrong in ["", "token=", "token=0123456789abcdeg", "taken=0123456789abcdef"] {
            assert_eq!(status("localhost:8480", "", wrong), Err("401"), "{wrong}");
        }
        let bearer = Request { bearer: Some("0123456789abcdef".into()), ..request("h", "", "") };
        assert_eq!(door.admit(&bearer), Ok(()));
    }
}
