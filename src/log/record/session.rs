//! Head of a log: build, configuration, survey and start time.

use super::convert::vec3;
use super::identity::BuildIdentity;
use super::pb;
use haltere_core::checks::Problems;
use haltere_core::checks::schema::{NotReadable, Schema};
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

/// What a replay needs before the first input.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// Who wrote the log.
    pub build: BuildIdentity,
    /// Wall clock at start, microseconds since 1970 UTC. Host times count from elsewhere.
    pub started_unix_us: i64,
    /// Start time that the core was given.
    pub pilot_started_at: HostTime,
    /// The whole resolved configuration, defaults included.
    pub config_toml: String,
    /// The survey as flown.
    pub survey: Survey,
}

impl Session {
    pub(super) fn message(&self) -> pb::Session {
        let build = self.build.clone();
        pb::Session {
            schema_version: Schema::LOG.newest(),
            program_version: build.program_version,
            git_commit: build.git_commit,
            source_hash: build.source_hash,
            target: build.target,
            rustc: build.rustc,
            build_profile: build.build_profile,
            processor: build.processor,
            started_unix_us: self.started_unix_us,
            pilot_started_us: self.pilot_started_at.as_us(),
            config_toml: self.config_toml.clone(),
            anchors: self
                .survey
                .ids()
                .iter()
                .filter_map(|id| Some((id, self.survey.position_E_m(*id)?)))
                .map(|(id, pos)| pb::SurveyedAnchor { id: u32::from(id.0), pos_e_m: vec3(pos) })
                .collect(),
        }
    }

    /// Refuses a log whose version this build does not know.
    pub(super) fn check_schema(message: &pb::Session) -> Result<(), NotReadable> {
        match message.schema_version {
            // A log from before it was written.
            0 => Ok(()),
            found => Schema::LOG.check(found),
        }
    }

    pub(super) fn from_message(message: pb::Session) -> Result<Self, Problems> {
        let anchors: Vec<_> = message
            .anchors
            .iter()
            .filter_map(|anchor| {
                let pos = anchor.pos_e_m?;
                Some((AnchorId(u8::try_from(anchor.id).ok()?), Vec3::new(pos.x, pos.y, pos.z)))
            })
            .collect();
        Ok(Self {
            build: BuildIdentity {
                program_version: message.program_version,
                git_commit: message.git_commit,
                source_hash: message.source_hash,
                target: message.target,
                rustc: message.rustc,
                build_profile: message.build_profile,
                processor: message.processor,
            },
            started_unix_us: message.started_unix_us,
            pilot_started_at: HostTime::from_us(message.pilot_started_us),
            config_toml: message.config_toml,
            survey: Survey::new(&anchors)?,
        })
    }
}
