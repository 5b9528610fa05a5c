//! The Foxglove WebSocket protocol, version 1, as far as a server that only publishes needs it. No I/O.
//!
//! Source: the public specification, `docs/spec.md` of the repository `foxglove/ws-protocol`: server info
//! and advertisement come first, as JSON; a client subscribes to channels under ids of its own; messages
//! are binary, opcode 1, subscription as u32, time as u64 ns, both little-endian, payload. Channels are the
//! decoded ones of the flight log, with the same names, protobuf types and schema.

use std::collections::BTreeMap;

use data_encoding::BASE64;
use serde::Deserialize;
use serde_json::{Value, json};

use haltere_log::record::{DESCRIPTORS, Decoded};

/// Sub-protocol of the handshake.
pub(super) const PROTOCOL: &str = "foxglove.websocket.v1";
/// Opcode of a message with data.
const MESSAGE_DATA: u8 = 1;
/// Levels of a status message.
const WARNING: u8 = 1;
const ERROR: u8 = 2;

/// The first message to a client. `session` tells servers apart.
pub(super) fn server_info(session: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": concat!("haltere ", env!("CARGO_PKG_VERSION")),
        "capabilities": [],
        "metadata": {},
        "sessionId": session,
    })
    .to_string()
}

/// The second: every channel, its number being its place in [`Decoded::CHANNELS`].
pub(super) fn advertise() -> String {
    let schema = BASE64.encode(DESCRIPTORS);
    let channels: Vec<Value> = (0..)
        .zip(Decoded::CHANNELS)
        .map(|(id, (topic, name)): (u32, _)| {
            json!({
                "id": id,
                "topic": topic,
                "encoding": "protobuf",
                "schemaName": name,
                "schema": schema,
                "schemaEncoding": "protobuf",
            })
        })
        .collect();
    json!({ "op": "advertise", "channels": channels }).to_string()
}

fn status(level: u8, message: &str) -> String {
    json!({ "op": "status", "level": level, "message": message }).to_string()
}

/// Tells a client what it missed.
pub(super) fn missed(messages: u64) -> String {
    status(WARNING, &format!("{messages} messages left out: this connection is too slow"))
}

/// What a client may say.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Said {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u32,
}

/// What one client wants: channel to its own id. Never more than there are channels.
#[derive(Debug, Default)]
pub(super) struct Subscriptions(BTreeMap<u32, u32>);

impl Subscriptions {
    /// Takes in what the client said; gives what it is to be told.
    pub(super) fn said(&mut self, text: &str) -> Option<String> {
        match serde_json::from_str(text) {
            Ok(Said::Subscribe { subscriptions }) => {
                let mut refused = None;
                for Subscription { id, channel_id } in subscriptions {
                    let known =
                        usize::try_from(channel_id).is_ok_and(|n| n < Decoded::CHANNELS.len());
                    if !known {
                        refused = Some(format!("there is no channel {channel_id}"));
                    } else if self.0.contains_key(&channel_id)
                        || self.0.values().any(|other| *other == id)
                    {
                        refused = Some(format!(
                            "channel {channel_id} or subscription {id} is in use already"
                        ));
                    } else {
                        self.0.insert(channel_id, id);
                    }
                }
                refused.map(|why| status(ERROR, &why))
            }
            Ok(Said::Unsubscribe { subscription_ids }) => {
                self.0.retain(|_, id| !subscription_ids.contains(id));
                None
            }
            Ok(Said::Other) => Some(status(WARNING, "this server only publishes")),
            Err(error) => Some(status(ERROR, &format!("not understood: {error}"))),
        }
    }

    /// The frame of a message for this client. `None`: it does not want the channel.
    pub(super) fn frame(&self, channel: u32, unix_ns: u64, payload: &[u8]) -> Option<Vec<u8>> {
        let id = self.0.get(&channel)?;
        let mut frame = Vec::with_capacity(13 + payload.len());
        frame.push(MESSAGE_DATA);
        frame.extend(id.to_le_bytes());
        frame.extend(unix_ns.to_le_bytes());
        frame.extend(payload);
        Some(frame)
    }
}

/// Number of a channel.
pub(super) fn channel(name: &str) -> Option<u32> {
    Decoded::CHANNELS
        .iter()
        .position(|(topic, _)| *topic == name)
        .and_then(|n| u32::try_from(n).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_messages_have_the_fields_of_the_specification() {
        let info: Value = serde_json::from_str(&server_info("7")).unwrap();
        assert_eq!(info["op"], "serverInfo");
        assert!(info["name"].is_string() && info["capabilities"].is_array());
        let advertised: Value = serde_json::from_str(&advertise()).unwrap();
        let channels = advertised["channels"].as_array().unwrap();
        assert_eq!(channels.len(), Decoded::CHANNELS.len());
        let n = channel("/estimate").unwrap();
        assert_eq!(channels[n as usize]["topic"], "/estimate");
        assert_eq!(channels[n as usize]["id"], n);
        assert_eq!(channels[n as usize]["schemaName"], "haltere.Estimate");
        let schema = channels[0]["schema"].as_str().unwrap();
        assert_eq!(BASE64.decode(schema.as_bytes()).unwrap(), DESCRIPTORS);

        let mut subscriptions = Subscriptions::default();
        let ask = |n: u32, id: u32| {
            json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": n }] })
                .to_string()
        };
        assert_eq!(subscriptions.frame(n, 5, b"x"), None);
        assert_eq!(subscriptions.said(&ask(n, 300)), None);
        let frame = subscriptions.frame(n, 0x0102_0304_0506_0708, b"xy").unwrap();
        assert_eq!(frame, [1, 44, 1, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, b'x', b'y']);
        assert_eq!(subscriptions.frame(n + 1, 5, b"x"), None);
        assert_eq!(subscriptions.said(r#"{"op":"unsubscribe","subscriptionIds":[300]}"#), None);
        assert_eq!(subscriptions.frame(n, 5, b"x"), None);
    }

    #[test]
    fn prop_what_cannot_be_is_answered_and_nothing_grows() {
        let mut subscriptions = Subscriptions::default();
        for text in ["", "{}", "[1,2]", "{\"op\":7}", "{\"op\":\"subscribe\"}", "\u{0}"] {
            assert!(subscriptions.said(text).unwrap().contains("\"level\":2"), "{text}");
        }
        let other = subscriptions.said(r#"{"op":"getParameters","parameterNames":[]}"#).unwrap();
        assert!(other.contains("only publishes"));
        for n in 0..1000 {
            let text =
                format!(r#"{{"op":"subscribe","subscriptions":[{{"id":{n},"channelId":{n}}}]}}"#);
            subscriptions.said(&text);
        }
        assert_eq!(subscriptions.0.len(), Decoded::CHANNELS.len());
        let again = r#"{"op":"subscribe","subscriptions":[{"id":5000,"channelId":0}]}"#;
        assert!(subscriptions.said(again).unwrap().contains("in use already"));
    }
}
