//! What the fuzzers call. The same bodies are run by `tests/corpus.rs` of the main build on every file of
//! the kept corpus, so that what was found once is never lost.

pub mod targets;
