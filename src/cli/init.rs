//! `haltere init`: a few questions, two commented files.

use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, anyhow, bail};
use clap::{Args, ValueEnum};

use super::output::print;
use crate::live::usb::serial_devices;
use crate::preflight::crazyflie;
use crate::preflight::first::{self, Answers};
use crate::preflight::probe;
use crate::preflight::stations::{self, Client};
use haltere_pilot::TagProtocol;
use haltere_pilot::settings::{Address, EndpointConfig, TagPort, parse_anchors};

/// Axes of anchors that are written as lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Frame {
    /// x east, y north, z up.
    Enu,
    /// x north, y east, z down.
    Ned,
}

/// What the tag speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Protocol {
    /// A Loco Positioning Node in sniffer mode.
    LpsSniffer,
    /// A tag that sends UWB_TDOA.
    Mavlink,
}

/// Writes haltere.toml and anchors.toml. On a terminal it asks for what no option says; elsewhere, or
/// with --yes, it takes what it finds and the defaults.
#[derive(Debug, Args)]
pub(super) struct Init {
    /// Folder for both files.
    #[arg(long, value_name = "DIR", default_value = ".")]
    dir: PathBuf,
    /// Device of the tag, or auto.
    #[arg(long, value_name = "DEVICE")]
    tag: Option<String>,
    /// What the tag speaks.
    #[arg(long, value_enum, default_value = "lps-sniffer")]
    tag_protocol: Protocol,
    /// Where the board is: serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcpout:HOST:PORT; a Crazyflie:
    /// radio:0/80/2M/E7E7E7E7E7, crtpusb:auto, crtpudp:HOST:PORT.
    #[arg(long, value_name = "ADDR")]
    board: Option<Address>,
    /// Where a ground station is; may be given several times.
    #[arg(long, value_name = "ADDR")]
    ground: Vec<Address>,
    /// What the vehicle is commanded with: writes the endpoint that it finds by itself; may be given several times.
    #[arg(long, value_enum, value_name = "NAME", conflicts_with = "ground")]
    station: Vec<Client>,
    /// Anchors: an anchor file, or lines `id x y z` in metres; - reads standard input.
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    /// One anchor; may be given several times.
    #[arg(long, value_name = "ID=X,Y,Z", conflicts_with = "anchors")]
    anchor: Vec<String>,
    /// Axes of anchors that are written as lines.
    #[arg(long, value_enum, default_value = "enu")]
    frame: Frame,
    /// Where logs go.
    #[arg(long, value_name = "DIR")]
    logs: Option<PathBuf>,
    /// Where settings of stations are kept.
    #[arg(long, value_name = "DIR")]
    store: Option<PathBuf>,
    /// Do not look for a board at its ports.
    #[arg(long)]
    no_probe: bool,
    /// Ask nothing.
    #[arg(long, short)]
    yes: bool,
    /// Replace files that are there already.
    #[arg(long)]
    force: bool,
}

/// Where the service of the package has its configuration, and its logs and settings.
const SERVICE_CONFIGURATION: &str = "/etc/haltere";
const SERVICE_STATE: &str = "/var/lib/haltere";

impl Init {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let asks = !self.yes && std::io::stdin().is_terminal();
        // What needs no listening first: nobody waits for a refusal.
        if !self.force {
            first::none_there(&self.dir).map_err(|why| anyhow!(why))?;
        }
        let told = if asks || self.asks_the_board() { None } else { Some(self.anchors(false)?) };
        let usual = Answers::default();
        let is_named = self.board.as_ref().is_some_and(Address::is_crazyflie);
        let tag = if is_named { usual.tag } else { self.tag(asks)? };
        let board = self.board(asks)?;
        let of_board = told.or_else(|| self.anchors_of(&board));
        let mut answers = Answers {
            tag,
            tag_protocol: match self.tag_protocol {
                Protocol::LpsSniffer => TagProtocol::LpsSniffer,
                Protocol::Mavlink => TagProtocol::Mavlink,
            },
            board,
            ground: self.ground(asks, &usual.ground)?,
            anchors: of_board.map_or_else(|| self.anchors(asks), Ok)?,
            ..usual
        };
        if self.dir == Path::new(SERVICE_CONFIGURATION) {
            // The service works there, people elsewhere: both shall mean the same folders.
            let state = Path::new(SERVICE_STATE);
            (answers.logs, answers.store) = (state.join(&answers.logs), state.join(&answers.store));
        }
        if let Some(logs) = &self.logs {
            answers.logs.clone_from(logs);
        }
        if let Some(store) = &self.store {
            answers.store.clone_from(store);
        }
        let files = first::write(&answers, &self.dir, self.force).map_err(|why| anyhow!(why))?;
        for file in &files {
            print(&format!("{}\n", file.display()))?;
        }
        let [config, _] = &files;
        say(&format!("next: haltere check --live --config {}", config.display()));
        Ok(ExitCode::SUCCESS)
    }

    /// Whether a Crazyflie may tell where its anchors are, and nobody else does.
    fn asks_the_board(&self) -> bool {
        let is_one = match &self.board {
            Some(told) => told.is_crazyflie(),
            None => !self.no_probe && crazyflie::may_be_there(),
        };
        is_one && self.anchors.is_none() && self.anchor.is_empty()
    }

    /// The anchors as a Crazyflie has them.
    fn anchors_of(&self, board: &Address) -> Option<String> {
        if self.anchors.is_some() || !self.anchor.is_empty() || !board.is_crazyflie() {
            return None;
        }
        let met = crazyflie::meet(board).ok().flatten()?;
        if met.anchors.is_empty() {
            say(
                "anchors: the Crazyflie knows of none: switch them on, in TDoA2, each with its position (cfclient, Loco \
                 Positioning tab), with the deck on the vehicle",
            );
            return None;
        }
        say(&format!("anchors: {} say where they are", met.anchors.len()));
        let lines = met.anchors.iter().map(|(id, [x, y, z])| format!("{id} {x} {y} {z}\n"));
        first::anchor_file(&lines.collect::<String>(), "enu").ok()
    }

    fn tag(&self, asks: bool) -> anyhow::Result<TagPort> {
        if let Some(told) = &self.tag {
            return Ok(TagPort::from(told.clone()));
        }
        let usb = serial_devices();
        let found = usb.iter().find(|usb| usb.is_tag());
        match found {
            Some(tag) => say(&format!("tag: {tag}")),
            None => {
                say("tag: no Loco Positioning Node is plugged in (USB 0483:5740)");
                for other in &usb {
                    say(&format!("  on USB: {other}"));
                }
            }
        }
        if self.tag_protocol == Protocol::Mavlink && !asks {
            bail!("--tag-protocol mavlink: such a tag is not found by itself; name it with --tag");
        }
        if !asks {
            return Ok(TagPort::Auto);
        }
        let default = if self.tag_protocol == Protocol::Mavlink { "" } else { "auto" };
        loop {
            let told = ask("device of the tag; auto finds a node by its USB identity", default)?;
            if !told.is_empty() {
                return Ok(TagPort::from(told));
            }
        }
    }

    fn board(&self, asks: bool) -> anyhow::Result<Address> {
        if let Some(told) = &self.board {
            if !self.no_probe {
                heard(told);
            }
            return Ok(told.clone());
        }
        let default = Answers::default().board;
        let found = if self.no_probe { None } else { look_for_board() };
        if found.is_none() {
            say("board: none was found");
        }
        if !asks {
            if found.is_none() {
                say(&format!(
                    "board: {default} is written; change board.address if it is elsewhere"
                ));
            }
            return Ok(found.unwrap_or(default));
        }
        let default = found.unwrap_or(default).to_string();
        loop {
            let told =
                ask("address of the board (serial:DEVICE:BAUD, udpin:HOST:PORT, …)", &default)?;
            match told.parse::<Address>() {
                Ok(address) => {
                    if !self.no_probe && told != default {
                        heard(&address);
                    }
                    return Ok(address);
                }
                Err(error) => say(&error.to_string()),
            }
        }
    }

    fn ground(
        &self,
        asks: bool,
        default: &[EndpointConfig],
    ) -> anyhow::Result<Vec<EndpointConfig>> {
        let plain = |all: &[Address]| all.iter().cloned().map(EndpointConfig::from).collect();
        if !self.ground.is_empty() {
            return Ok(plain(&self.ground));
        }
        if !self.station.is_empty() {
            return chosen(&self.station, asks);
        }
        if !asks {
            return Ok(default.to_owned());
        }
        let names = Client::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        let names = names.map(|name| name.get_name().to_owned()).collect::<Vec<_>>().join(", ");
        let question = format!("what commands it ({names}), or addresses; spaces between");
        loop {
            let told = ask(&question, "pymavlink")?;
            let words: Vec<&str> = told.split_whitespace().collect();
            let clients: Result<Vec<_>, _> =
                words.iter().map(|word| Client::from_str(word, true)).collect();
            if let Ok(clients) = clients {
                return chosen(&clients, true);
            }
            match words.into_iter().map(str::parse).collect::<Result<Vec<Address>, _>>() {
                Ok(all) => return Ok(plain(&all)),
                Err(error) => say(&format!("{error}; or of {names}")),
            }
        }
    }

    fn anchors(&self, asks: bool) -> anyhow::Result<String> {
        if let Some(path) = &self.anchors {
            return self.read_anchors(path);
        }
        if !self.anchor.is_empty() {
            let lines: Vec<_> = self.anchor.iter().map(|a| a.replacen('=', ",", 1)).collect();
            return self.to_file("--anchor", &lines.join("\n"));
        }
        if !asks {
            bail!(
                "the anchors must be known: --anchors FILE (an anchor file, or lines `id x y z` in \
                 metres), or --anchor ID=X,Y,Z for each"
            );
        }
        loop {
            let told = ask(
                "file of the anchors (anchor file, or lines `id x y z`); empty: type them",
                "",
            )?;
            let read = if told.is_empty() {
                self.typed_anchors()
            } else {
                self.read_anchors(Path::new(&told))
            };
            match read {
                Ok(text) => return Ok(text),
                Err(error) => say(&format!("{error:#}")),
            }
        }
    }

    fn typed_anchors(&self) -> anyhow::Result<String> {
        let axes = match self.frame {
            Frame::Enu => "x east, y north, z up",
            Frame::Ned => "x north, y east, z down",
        };
        say(&format!("one anchor a line: id x y z, metres ({axes}); an empty line ends"));
        let mut text = String::new();
        loop {
            let line = read_line()?;
            if line.is_empty() {
                return self.to_file("anchors", &text);
            }
            match first::anchor_file(&line, self.frame_name()) {
                Ok(_) => text += &(line + "\n"),
                Err(why) => say(&why),
            }
        }
    }

    fn read_anchors(&self, path: &Path) -> anyhow::Result<String> {
        let name = path.display().to_string();
        let text = if name == "-" {
            std::io::read_to_string(std::io::stdin())
        } else {
            haltere_log::intake::text(path, 4 << 20)
        };
        self.to_file(&name, &text.with_context(|| format!("{name}: cannot be read"))?)
    }

    fn to_file(&self, name: &str, text: &str) -> anyhow::Result<String> {
        let file =
            first::anchor_file(text, self.frame_name()).map_err(|why| anyhow!("{name}: {why}"))?;
        parse_anchors(name, &file).map_err(|problems| anyhow!("{problems}"))?;
        Ok(file)
    }

    fn frame_name(&self) -> &'static str {
        match self.frame {
            Frame::Enu => "enu",
            Frame::Ned => "ned",
        }
    }
}

/// Says whether a board is heard at an address that somebody named.
fn heard(address: &Address) {
    if address.is_crazyflie() {
        return match crazyflie::meet(address) {
            Ok(Some(met)) => say(&format!("board: {met}, at {address}")),
            Ok(None) => {
                say(&format!("board: no Crazyflie answers at {address}; it is written as told"))
            }
            Err(why) => say(&format!("board: {why}; it is written as told")),
        };
    }
    match probe::at(address) {
        Ok(Some(board)) => say(&format!("board: {board}, heard at {address}")),
        Ok(None) => say(&format!("board: nobody heard at {address}; it is written as told")),
        Err(why) => say(&format!("board: {why}; it is written as told")),
    }
}

/// The endpoints of these, with what is typed in each; offers the map of modes to those that need it.
fn chosen(clients: &[Client], asks: bool) -> anyhow::Result<Vec<EndpointConfig>> {
    let all = stations::endpoints(clients);
    for (client, port, _) in &all {
        let name = client.to_possible_value();
        let name = name.as_ref().map_or("", |name| name.get_name());
        say(&format!("{name}: {}", client.typed(*port)));
    }
    let home = std::env::home_dir().filter(|_| clients.iter().any(|client| client.wants_map()));
    if let Some(place) = home.and_then(|home| stations::map_is_due(&home)) {
        let shown = place.display();
        if asks && ask(&format!("write the names of modes to {shown}"), "yes")? == "yes" {
            stations::lay_map(&place).map_err(|why| anyhow!(why))?;
        } else {
            say(&format!(
                "{shown} would name the modes: copy stations/custom_mode_map.json of the sources there, or let \
                 `haltere init` do it, on a terminal"
            ));
        }
    }
    Ok(all.into_iter().map(|(_, _, endpoint)| endpoint).collect())
}

fn look_for_board() -> Option<Address> {
    if let Some(address) = crazyflie::look(say) {
        return Some(address);
    }
    for device in probe::candidates() {
        let name = device.display().to_string();
        let found = probe::speed_of(&device, |baud| {
            say(&format!("board: listening at {name}, {baud} baud"))
        });
        match found {
            Ok(Some((baud, board))) => {
                say(&format!("board: {board}, heard at {name}, {baud} baud"));
                return Some(Address::Serial { device, baud });
            }
            Ok(None) => {}
            Err(why) => say(&format!("board: {why}")),
        }
    }
    if let Err(why) = crate::live::radio::find() {
        say(&format!("board: for a Crazyflie: {why}"));
    }
    None
}

fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Asks; an empty answer is the default.
fn ask(question: &str, default: &str) -> anyhow::Result<String> {
    let mut err = std::io::stderr();
    let shown = if default.is_empty() { String::new() } else { format!(" [{default}]") };
    let _ = write!(err, "{question}{shown}: ");
    let _ = err.flush();
    let told = read_line()?;
    Ok(if told.is_empty() { default.to_owned() } else { told })
}

fn read_line() -> anyhow::Result<String> {
    let mut line = String::new();
    if std::io::stdin().lock().read_line(&mut line)? == 0 {
        bail!("the answers ended; nothing is written");
    }
    Ok(line.trim().to_owned())
}
