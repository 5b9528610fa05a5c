//! SIGTERM and SIGINT as a flag that loops look at.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};

/// Set when the process was asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Listens for both signals from now on.
    pub fn on_signals() -> Result<Self> {
        let stop = Self::default();
        let flag = stop.clone();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .context("no runtime for signals")?;
        std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || {
                runtime.block_on(async {
                    use tokio::signal::unix::{SignalKind, signal};
                    let terminate = signal(SignalKind::terminate());
                    let interrupt = signal(SignalKind::interrupt());
                    let (Ok(mut terminate), Ok(mut interrupt)) = (terminate, interrupt) else {
                        return;
                    };
                    tokio::select! {
                        _ = terminate.recv() => {}
                        _ = interrupt.recv() => {}
                    }
                    flag.0.store(true, Ordering::Relaxed);
                });
            })
            .context("no thread for signals")?;
        Ok(stop)
    }

    /// Asks for it.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it is time to go.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
