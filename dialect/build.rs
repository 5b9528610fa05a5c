//! Generates the MAVLink code from `xml/haltere.xml` and the XML that the `mavlink` crate ships.
//!
//! The generator resolves `<include>` only beside the including file, so both are staged in
//! `OUT_DIR`. `cargo metadata` finds the crate's source on any machine, vendored or not.

use std::{env, error::Error, fs, path::PathBuf, process::Command};

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

    let generated = out_dir.join("generated");
    fs::create_dir_all(&generated)?;
    mavlink_bindgen::generate(
        mavlink_bindgen::XmlDefinitions::Files(vec![stage.join("haltere.xml")]),
        generated,
    )?;
    Ok(())
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
