//! The thread that works for the core on the disk: tasks in, answers out, both queues bounded.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use super::shared::Shared;
use crate::store::{Answer, Store};
use haltere_pilot::services::{FileFault, FileRequest, PARAMETERS_TICKET};

/// Tasks that may wait: as many as the core has under way at most.
const QUEUE_TASKS: usize = 64;
/// How often the thread looks whether to end.
const LOOK: Duration = Duration::from_millis(100);

/// The core's end of the queues.
pub(super) struct FileDesk {
    tasks: Option<SyncSender<FileRequest>>,
    answers: Receiver<(u32, Answer)>,
    /// Answers that need no disk.
    own: Vec<(u32, Answer)>,
    /// Tasks that the disk has not answered.
    at_work: usize,
}

impl FileDesk {
    /// Hands a task over; never waits.
    pub(super) fn submit(&mut self, request: FileRequest) {
        let ticket = request.ticket;
        let fault = match &self.tasks {
            None => FileFault::Off,
            Some(tasks) => match tasks.try_send(request) {
                Ok(()) => {
                    self.at_work += 1;
                    return;
                }
                Err(TrySendError::Full(_)) => FileFault::Busy,
                Err(TrySendError::Disconnected(_)) => FileFault::Failed,
            },
        };
        self.own.push((ticket, Err((fault, Vec::new()))));
    }

    /// One answer, if there is one; never waits.
    pub(super) fn answer(&mut self) -> Option<(u32, Answer)> {
        self.own.pop().or_else(|| {
            let answer = self.answers.try_recv().ok()?;
            self.at_work = self.at_work.saturating_sub(1);
            Some(answer)
        })
    }

    /// Whether no answer is to come: none must reach a core that did not ask.
    pub(super) fn is_idle(&self) -> bool {
        self.own.is_empty() && self.at_work == 0
    }
}

/// Starts the thread. Without a store there is none, and every task is refused. `lost`: why parameters that
/// were kept are not in force.
pub(super) fn start(
    store: Option<Store>,
    lost: Option<&str>,
    shared: Arc<Shared>,
) -> std::io::Result<(FileDesk, Option<JoinHandle<()>>)> {
    let (tasks, todo) = sync_channel::<FileRequest>(QUEUE_TASKS);
    let (done, answers) = sync_channel(2 * QUEUE_TASKS);
    let Some(store) = store else {
        return Ok((FileDesk { tasks: None, answers, own: Vec::new(), at_work: 0 }, None));
    };
    let thread = std::thread::Builder::new().name("files".into()).spawn(move || {
        loop {
            let FileRequest { ticket, task } = match todo.recv_timeout(LOOK) {
                Ok(request) => request,
                Err(RecvTimeoutError::Timeout) if !shared.stopped() => continue,
                Err(_) => return,
            };
            let answer = store.work(&task);
            if let Err((fault, why)) = &answer
                && matches!(fault, FileFault::Failed | FileFault::Full)
            {
                let why = String::from_utf8_lossy(why);
                tracing::warn!("store: {}: {why}", fault.words());
            }
            // The core has given up waiting long before this queue is full.
            let _ = done.try_send((ticket, answer));
        }
    })?;
    let told = lost.map(|why| (FileFault::Nonsense, why.as_bytes().to_vec()));
    let own = told.map(|lost| (PARAMETERS_TICKET, Err(lost))).into_iter().collect();
    Ok((FileDesk { tasks: Some(tasks), answers, own, at_work: 0 }, Some(thread)))
}
