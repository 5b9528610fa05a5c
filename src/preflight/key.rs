//! The key of signed MAVLink: one that would keep `fly` from starting is to be known before.

use super::Finding;
use crate::sources::{KeyFileError, read_key, read_time};
use haltere_pilot::settings::Config;

/// The key file and the time beside it, where one is configured.
pub fn examine(config: &Config) -> Vec<Finding> {
    let file = &config.signing.key_file;
    if file.as_os_str().is_empty() {
        return Vec::new();
    }
    let what = "signing.key_file";
    let shown = file.display();
    let mut findings = vec![match read_key(file) {
        Ok(_) => Finding::ok(what, format!("{shown}: a key that nobody else can read")),
        Err(KeyFileError::Missing { .. }) if config.may_be_given_key() => Finding::warning(
            what,
            format!("{shown}: no key yet"),
            "it may come with SETUP_SIGNING; or make one with `haltere key`",
        ),
        Err(error) => Finding::problem(
            what,
            error.to_string(),
            "`haltere key` makes a key that only its owner can read (docs/SECURITY.md)",
        ),
    }];
    if let Err(why) = read_time(file) {
        findings.push(Finding::warning(
            what,
            why,
            "remove the file of the time once the clock of this computer is right",
        ));
    }
    findings
}
