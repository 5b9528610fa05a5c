//! One link's door: bytes in any chunking in, whole frames that may pass out.
//!
//! Only whole frames pass, and what is between them does not: bytes that the door took for garbage must
//! not grow together with the next frame behind it into one that it never saw.

use std::sync::Arc;

use haltere_dialect::mav_stream::{MavFrame, MavLoss, MavSplitter};
use haltere_dialect::signing::{KEY_BYTES, SigningKey};

use super::rate::Bucket;
use super::{KeyRing, KeySetup, RateLimit, Signing, Standing};
use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::HostTime;

/// SETUP_SIGNING, and where its fields stand: initial_timestamp (8), target system, target component,
/// key. By id, not by name: it must not pass, whatever else is in it.
const SETUP_SIGNING_ID: u32 = 256;
const SETUP_TARGET_AT: usize = 8;
const SETUP_KEY_AT: usize = 10;
const SETUP_BYTES: usize = SETUP_KEY_AT + KEY_BYTES;

/// What a door is told.
#[derive(Debug, Clone, PartialEq)]
pub struct DoorConfig {
    /// What it demands.
    pub signing: Signing,
    /// Who may give a key here.
    pub setup: KeySetup,
    /// Systems that may, if they may at all; `None`: all.
    pub commanders: Option<Arc<[u8]>>,
    /// Ids of messages that pass unsigned everywhere.
    pub unsigned: Arc<[u32]>,
    /// What the link may bring in; `None`: anything.
    pub rate: Option<RateLimit>,
    /// Our own addresses here: `None` as system is any.
    pub own: (Option<u8>, u8),
}

/// A key that was offered and accepted.
#[derive(Debug, PartialEq, Eq)]
pub struct KeyOffer {
    /// The key, in force already.
    pub key: SigningKey,
}

/// The door.
#[derive(Debug)]
pub struct Door {
    config: DoorConfig,
    splitter: MavSplitter,
    frames: Option<Bucket>,
    bytes: Option<Bucket>,
}

impl Door {
    /// A door to a link that nothing came over yet.
    pub fn new(config: DoorConfig) -> Self {
        let frames = config.rate.as_ref().map(Bucket::of_frames);
        let bytes = config.rate.as_ref().map(Bucket::of_bytes);
        Self { config, splitter: MavSplitter::new(), frames, bytes }
    }

    /// What it demands.
    pub fn signing(&self) -> Signing {
        self.config.signing
    }

    /// Somebody else speaks now: the rest of a frame that was cut off will not come.
    pub fn reopen(&mut self) {
        *self = Self::new(self.config.clone());
    }

    /// Lets through what may pass: appends whole frames to `passed`.
    pub fn admit(
        &mut self,
        ring: &mut KeyRing,
        at: HostTime,
        unix_us: i64,
        bytes: &[u8],
        passed: &mut Vec<u8>,
        drops: &mut Drops,
    ) -> Option<KeyOffer> {
        if let Some(bucket) = &mut self.bytes
            && !bucket.take(at, bytes.len() as f64)
        {
            drops.add(DropReason::RateLimited, 1);
            // What came before the hole will not be completed.
            self.splitter.flush();
        } else {
            self.splitter.push(bytes);
        }
        let mut offered = None;
        let Self { config, splitter, frames, .. } = self;
        while let Some(next) = splitter.next() {
            let frame = match next {
                Ok(frame) => frame,
                Err(loss) => {
                    count(drops, &loss);
                    continue;
                }
            };
            if let Some(bucket) = frames
                && !bucket.take(at, 1.0)
            {
                drops.add(DropReason::RateLimited, 1);
                continue;
            }
            match config.judge(ring, &frame, unix_us) {
                Ok(_) if frame.header.msg_id != SETUP_SIGNING_ID => {
                    passed.extend_from_slice(frame.raw);
                }
                Ok(standing) => match config.take_key(ring, &frame, standing, unix_us) {
                    Some(offer) => offered = Some(offer),
                    None => drops.add(DropReason::SigningSetup, 1),
                },
                Err(reason) => drops.add(reason, 1),
            }
        }
        offered
    }

    /// Whether a stranger with these bytes may come in at all, or why not: takes note of nothing.
    pub fn would_open(&self, ring: &KeyRing, unix_us: i64, bytes: &[u8]) -> Result<(), DropReason> {
        if self.config.signing != Signing::Require {
            return Ok(());
        }
        let mut why = DropReason::MavUnsigned;
        let mut splitter = MavSplitter::new();
        splitter.push(bytes);
        while let Some(next) = splitter.next() {
            let Ok(frame) = next else { continue };
            let may_set_up = frame.header.msg_id == SETUP_SIGNING_ID
                && self.config.setup == KeySetup::Anybody
                && self.config.commands(frame.header.system_id);
            match ring.look(&frame, unix_us) {
                Standing::Signed => return Ok(()),
                _ if may_set_up => return Ok(()),
                Standing::Refused(reason) => why = reason,
                Standing::Unsigned => {}
            }
        }
        Err(why)
    }

    /// Brings a frame into the form in which it goes out.
    pub fn seal(&self, ring: &mut KeyRing, link_id: u8, unix_us: i64, frame: &mut Vec<u8>) {
        let sender = frame.get(5).copied().zip(frame.get(6).copied());
        let (system, component) = self.config.own;
        let own = sender.is_some_and(|(s, c)| system.is_none_or(|own| own == s) && component == c);
        if self.config.signing == Signing::Off || !own {
            // What others sent passes as they sent it.
            return;
        }
        if let Some(signed) = ring.sign(frame, link_id, unix_us) {
            // The buffer stays: it may belong to a stock.
            frame.clear();
            frame.extend_from_slice(&signed);
        }
    }
}

impl DoorConfig {
    fn judge(
        &self,
        ring: &mut KeyRing,
        frame: &MavFrame<'_>,
        unix_us: i64,
    ) -> Result<Standing, DropReason> {
        if self.signing == Signing::Off {
            return Ok(Standing::Unsigned);
        }
        match ring.admit(frame, unix_us) {
            Standing::Refused(reason) => Err(reason),
            Standing::Signed => Ok(Standing::Signed),
            Standing::Unsigned => {
                let id = frame.header.msg_id;
                let excepted = self.unsigned.contains(&id)
                    || id == SETUP_SIGNING_ID && self.setup == KeySetup::Anybody;
                if self.signing == Signing::Accept || excepted {
                    Ok(Standing::Unsigned)
                } else {
                    Err(DropReason::MavUnsigned)
                }
            }
        }
    }

    /// Whether this system may give a key, where anybody may: who has the key in force can exchange all others.
    fn commands(&self, system_id: u8) -> bool {
        self.commanders.as_ref().is_none_or(|ids| ids.contains(&system_id))
    }

    /// A key comes in.
    fn take_key(
        &self,
        ring: &mut KeyRing,
        frame: &MavFrame<'_>,
        standing: Standing,
        unix_us: i64,
    ) -> Option<KeyOffer> {
        let allowed = match self.setup {
            KeySetup::Never => false,
            KeySetup::Signed => standing == Standing::Signed,
            KeySetup::Anybody => true,
        };
        let sender = (frame.header.system_id, frame.header.component_id);
        if !allowed || !self.commands(sender.0) {
            return None;
        }
        // Trailing zeros are cut on the wire.
        let mut full = [0; SETUP_BYTES];
        for (to, from) in full.iter_mut().zip(frame.payload) {
            *to = *from;
        }
        let (timestamp, rest) = full.split_first_chunk::<SETUP_TARGET_AT>()?;
        let (&[system, component], key) = rest.split_first_chunk::<2>()?;
        let (own_system, own_component) = self.own;
        let for_us = (system == 0 || own_system.is_none_or(|own| own == system))
            && (component == 0 || component == own_component);
        // All zeros ask to sign no more, which is decided by hand only.
        let key = SigningKey::new(key.try_into().ok()?).filter(|_| for_us)?;
        let known = ring.is_key(&key);
        ring.change(key.clone(), u64::from_le_bytes(*timestamp), sender, unix_us);
        // Stations send it twice, to be sure: one offer.
        (!known).then_some(KeyOffer { key })
    }
}

fn count(drops: &mut Drops, loss: &MavLoss) {
    match loss {
        MavLoss::GarbageBytes(n) => drops.add(DropReason::MavGarbageByte, *n as u64),
        MavLoss::BadChecksum { .. } => drops.add(DropReason::MavBadChecksum, 1),
        MavLoss::Incompatible => drops.add(DropReason::MavIncompatible, 1),
        // Said by decoding, which a door does not do.
        MavLoss::UnknownId { .. } | MavLoss::Undecodable { .. } => {}
    }
}
