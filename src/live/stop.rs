//! How a running companion is asked to end, from any thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use tokio::sync::Notify;

/// Ends a running companion from another thread: landed first, or at once.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<State>);

#[derive(Debug, Default)]
struct State {
    asked: AtomicBool,
    at_once: AtomicBool,
    armed: AtomicBool,
    changed: Notify,
}

impl Stop {
    /// Asks it to end: what flies is landed first. The core decides, and the log holds it.
    pub fn ask(&self) {
        self.0.asked.store(true, Relaxed);
        self.0.changed.notify_one();
    }

    /// Ends it at once, wherever the vehicle is.
    pub fn stop(&self) {
        self.0.at_once.store(true, Relaxed);
        self.0.changed.notify_one();
    }

    /// Whether the vehicle was armed by us when the core was last awake.
    pub fn is_armed(&self) -> bool {
        self.0.armed.load(Relaxed)
    }

    pub(super) fn set_armed(&self, armed: bool) {
        self.0.armed.store(armed, Relaxed);
    }

    pub(super) fn is_asked(&self) -> bool {
        self.0.asked.load(Relaxed)
    }

    pub(super) fn is_at_once(&self) -> bool {
        self.0.at_once.load(Relaxed)
    }

    /// Returns when something was asked since it last returned.
    pub(super) async fn changed(&self) {
        self.0.changed.notified().await;
    }
}
