//! Generates the MAVLink code from `xml/haltere.xml` and the XML that the `mavlink` crate ships.
//!
//! The generator resolves `<include>` only beside the including file, so both are staged in
//! `OUT_DIR`. `cargo metadata` finds the crate's source on any machine, vendored or not.
//!
//! The generated code rejects a whole message for one value that its enums do not know, and whoever sent it
//! waits for an answer that never comes. So the fields of messages that come from others are staged without
//! their enums: they are read as the numbers that they are, and judged where they are used.

use std::{env, error::Error, fs, path::PathBuf, process::Command};

/// Messages that others send us.
const RECEIVED: [&str; 28] = [
    "HEARTBEAT",
    "BATTERY_STATUS",
    "COMMAND_ACK",
    "COMMAND_CANCEL",
    "COMMAND_INT",
    "COMMAND_LONG",
    "EXTENDED_SYS_STATE",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_PARTIAL_LIST",
    "MISSION_WRITE_PARTIAL_LIST",
    "ODOMETRY",
    "PARAM_EXT_ACK",
    "PARAM_EXT_SET",
    "PARAM_SET",
    "PARAM_VALUE",
    "PLAY_TUNE_V2",
    "REQUEST_DATA_STREAM",
    "SERIAL_CONTROL",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "SET_POSITION_TARGET_LOCAL_NED",
    "STATUSTEXT",
];

fn main() -> Result<(), Box<dyn Error>> {
    let manifest_dir = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?);
    let out_dir = PathBuf::from(env::var("OUT_DIR")?);
    let own_xml = manifest_dir.join("xml/haltere.xml");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={}", own_xml.display());

    let definitions = mavlink_definitions()?;
    let stage = out_dir.join("xml");
    fs::create_dir_all(&stage)?;
    for name in ["common.xml", "standard.xml", "minimal.xml"] {
        fs::copy(definitions.join(name), stage.join(name))
            .map_err(|e| format!("{}: {e}", definitions.join(name).display()))?;
    }
    fs::copy(&own_xml, stage.join("haltere.xml"))?;
    // Tests hand the same files to pymavlink's generator.
    println!("cargo:rustc-env=HALTERE_DIALECT_XML={}", stage.display());

    let lenient = out_dir.join("lenient");
    fs::create_dir_all(&lenient)?;
    let mut staged = Vec::new();
    for name in ["haltere.xml", "common.xml", "standard.xml", "minimal.xml"] {
        staged.push((name, fs::read_to_string(stage.join(name))?));
    }
    let bits: Vec<String> = staged.iter().flat_map(|(_, text)| bit_masks(text)).collect();
    for (name, text) in &staged {
        fs::write(lenient.join(name), with_numbers(text, &bits))?;
    }

    let generated = out_dir.join("generated");
    fs::create_dir_all(&generated)?;
    mavlink_bindgen::generate(
        mavlink_bindgen::XmlDefinitions::Files(vec![lenient.join("haltere.xml")]),
        generated,
    )?;
    Ok(())
}

/// Names of the enums whose values are sets of bits: unknown bits are kept as they are.
fn bit_masks(xml: &str) -> Vec<String> {
    xml.split("<enum")
        .skip(1)
        .filter_map(|rest| rest.split_once('>'))
        .filter(|(tag, _)| attribute(tag, "bitmask") == Some("true"))
        .filter_map(|(tag, _)| Some(attribute(tag, "name")?.to_owned()))
        .collect()
}

/// The definitions with the plain enums of [`RECEIVED`] left out.
fn with_numbers(xml: &str, bits: &[String]) -> String {
    let mut out = String::with_capacity(xml.len());
    let mut received = false;
    for (n, piece) in xml.split('<').enumerate() {
        let (tag, rest) = piece.split_once('>').unwrap_or((piece, ""));
        if tag.starts_with("message ") {
            received = attribute(tag, "name").is_some_and(|name| RECEIVED.contains(&name));
        }
        let plain = attribute(tag, "enum").filter(|name| !bits.iter().any(|bit| bit == name));
        let tag = match plain {
            Some(name) if received && tag.starts_with("field ") => {
                tag.replace(&format!(" enum=\"{name}\""), "")
            }
            _ => tag.to_owned(),
        };
        if n > 0 {
            out.push('<');
        }
        out.push_str(&tag);
        if piece.contains('>') {
            out.push('>');
        }
        out.push_str(rest);
    }
    out
}

/// The value of an attribute.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let (_, value) = tag.split_once(&format!(" {name}=\""))?;
    Some(value.split_once('"')?.0)
}

/// Folder of the XML files inside the source of the `mavlink` crate.
fn mavlink_definitions() -> Result<PathBuf, Box<dyn Error>> {
    let target = env::var("TARGET")?;
    // Not `--offline`: a fresh clone may lack packages of other platforms in its cache.
    let output = Command::new(env::var("CARGO")?)
        .args(["metadata", "--format-version", "1", "--filter-platform", &target])
        .arg("--manifest-path")
        .arg(PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("Cargo.toml"))
        .output()?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    let manifest = metadata["packages"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|p| p["name"] == "mavlink")
        .and_then(|p| p["manifest_path"].as_str())
        .ok_or("cargo metadata lists no package `mavlink`")?;
    let folder = PathBuf::from(manifest)
        .parent()
        .ok_or("package `mavlink` has no folder")?
        .join("mavlink/message_definitions/v1.0");
    Ok(folder)
}
