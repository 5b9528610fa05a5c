//! The first configuration of a vehicle: two commented files, checked before they are written.

use std::path::{Path, PathBuf};

use haltere_core::checks::schema::Schema;
use haltere_log::written::{Old, Output};
use haltere_pilot::settings::{
    Address, Config, EndpointConfig, HostPort, RecordConfig, StoreConfig, TagPort, commented,
    parse_anchors, reference,
};
use haltere_pilot::{BoardProfile, TagProtocol};

/// Name of the anchor file.
const ANCHORS: &str = "anchors.toml";

/// What has to be known.
#[derive(Debug, Clone, PartialEq)]
pub struct Answers {
    /// Device of the tag.
    pub tag: TagPort,
    /// What it speaks.
    pub tag_protocol: TagProtocol,
    /// Where the board is.
    pub board: Address,
    /// Where ground stations are.
    pub ground: Vec<EndpointConfig>,
    /// Where the page is served, for browsers on this computer.
    pub watch: Address,
    /// Content of the anchor file.
    pub anchors: String,
    /// Where logs go.
    pub logs: PathBuf,
    /// Where settings of stations are kept.
    pub store: PathBuf,
}

impl Default for Answers {
    fn default() -> Self {
        let config = Config::default();
        Self {
            tag: config.tag.port,
            tag_protocol: config.tag.protocol,
            board: config.board.address,
            ground: config.ground.endpoints,
            watch: Address::TcpIn(HostPort { host: "127.0.0.1".into(), port: WATCH_PORT }),
            anchors: String::new(),
            logs: RecordConfig::default().directory,
            store: StoreConfig::default().directory,
        }
    }
}

/// Writes `haltere.toml` and the anchor file into `directory`; gives both paths. Nothing is written
/// before all is right, and nothing is replaced unless `force`.
pub fn write(answers: &Answers, directory: &Path, force: bool) -> Result<[PathBuf; 2], String> {
    let config = directory.join(crate::sources::DEFAULT_FILE);
    let anchors = directory.join(ANCHORS);
    let text = configuration(answers);
    let name = |path: &Path| path.display().to_string();
    let parsed = Config::from_toml(&name(&config), &text).map_err(|p| p.to_string())?;
    let mut problems = haltere_core::checks::Problems::new();
    parsed.check("", &mut problems);
    problems.into_result().map_err(|p| p.to_string())?;
    parse_anchors(&name(&anchors), &answers.anchors).map_err(|p| p.to_string())?;
    if !force {
        none_there(directory)?;
    }
    std::fs::create_dir_all(directory)
        .map_err(|e| format!("{}: the folder cannot be made: {e}", directory.display()))?;
    for (path, text) in [(&config, &text), (&anchors, &answers.anchors)] {
        let old = if force { Old::Goes } else { Old::Stays };
        let mut file = Output::begin::<&Path>(path, &[], old).map_err(|e| e.to_string())?;
        file.put(text.as_bytes()).and_then(|()| file.finish()).map_err(|e| e.to_string())?;
    }
    Ok([config, anchors])
}

/// Refuses a folder that holds one of both files.
pub fn none_there(directory: &Path) -> Result<(), String> {
    let both = [crate::sources::DEFAULT_FILE, ANCHORS].map(|name| directory.join(name));
    match both.iter().find(|path| path.exists()) {
        None => Ok(()),
        Some(there) => Err(format!(
            "{}: exists already; name another folder with --dir, or say --force to replace it",
            there.display()
        )),
    }
}

/// The file, with the words of the sample above each key.
fn configuration(answers: &Answers) -> String {
    let quoted = |text: String| toml::Value::String(text).to_string();
    let list = answers.ground.iter().map(plain).collect::<Vec<_>>().join(", ");
    let mut set = vec![
        ("", Schema::KEY, Schema::CONFIGURATION.newest().to_string()),
        ("tag", "port", quoted(String::from(answers.tag.clone()))),
        ("board", "address", quoted(answers.board.to_string())),
        ("ground", "endpoints", format!("[{list}]")),
        ("anchors", "file", quoted(ANCHORS.to_owned())),
        ("record", "directory", quoted(answers.logs.display().to_string())),
        ("store", "directory", quoted(answers.store.display().to_string())),
        // Off by default; who sets a vehicle up wants to see it, and on this computer alone that harms nobody.
        ("watch", "address", quoted(answers.watch.to_string())),
    ];
    // Its deck is the tag, and its address says what it is.
    set.extend(if answers.board.is_crazyflie() {
        vec![
            ("tag", "protocol", plain(&TagProtocol::Crazyflie)),
            ("board", "profile", plain(&BoardProfile::Crazyflie)),
        ]
    } else {
        vec![("tag", "protocol", plain(&answers.tag_protocol))]
    });
    // Shown, and left at their defaults: what is usually wanted next.
    let shown = [("board", "profile"), ("board", "north_offset_deg"), ("ground", "identity")];
    let mut text = String::from(
        "# Configuration of the companion, made by `haltere init`. Only what differs from the defaults\n\
         # need stand here; docs/CONFIGURATION.md (or config/haltere.toml of the sources) tells every key.\n\
         # `haltere check` examines it, with --live also what tag and board really send.\n\n",
    );
    let mut section = "";
    let keys = reference();
    for key in &keys {
        let given = set.iter().find(|(s, k, _)| *s == key.section && *k == key.name);
        let named = |(s, k): &(&str, &str)| *s == key.section && *k == key.name;
        let limit = key.section == "limits" && key.absent;
        if given.is_none() && !shown.iter().any(named) && !limit {
            continue;
        }
        if section != key.section {
            section = &key.section;
            text += &format!("\n[{section}]\n");
        }
        text += &commented(&key.text);
        text += &match given {
            Some((_, _, value)) => format!("{} = {value}\n", key.name),
            None => format!("# {} = {}\n", key.name, key.value),
        };
    }
    text
}

/// Where the page is served.
const WATCH_PORT: u16 = 8480;

/// A value as TOML writes it.
fn plain(value: &impl serde::Serialize) -> String {
    toml::Value::try_from(value).map(|v| v.to_string()).unwrap_or_default()
}

/// An anchor file of lines `id x y z` (spaces, commas, semicolons or tabs between, # for comments), or of
/// what is one already. `frame`: enu or ned, of lines.
pub fn anchor_file(text: &str, frame: &str) -> Result<String, String> {
    if text.lines().any(|line| line.trim() == "[[anchor]]") {
        return Ok(text.to_owned());
    }
    let axes = if frame == "ned" { "x north, y east, z down" } else { "x east, y north, z up" };
    let mut file = format!(
        "# Where the UWB anchors stand: the antennas, not the boxes. The origin lies on the floor.\n\
         # frame = \"{frame}\": {axes}, metres.\nframe = \"{frame}\"\n"
    );
    let mut first = true;
    for (n, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let cells: Vec<&str> =
            line.split([',', ';', '\t', ' ']).map(str::trim).filter(|c| !c.is_empty()).collect();
        let numbers: Option<Vec<f64>> =
            cells.iter().skip(1).map(|c| c.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let id = cells.first().and_then(|c| c.parse::<u8>().ok());
        // A table usually has a head.
        let is_head = first && cells.len() == 4 && cells.iter().all(|c| c.parse::<f64>().is_err());
        first = false;
        match (id, numbers.as_deref()) {
            (Some(id), Some([x, y, z])) => {
                let position = toml::Value::from(vec![*x, *y, *z]);
                file += &format!("\n[[anchor]]\nid = {id}\nposition_m = {position}\n");
            }
            _ if is_head => {}
            _ => {
                return Err(format!(
                    "line {}: {line:?}; write each anchor as `id x y z`, id 0 to 255, metres",
                    n + 1
                ));
            }
        }
    }
    Ok(file)
}
