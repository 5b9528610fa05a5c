//! Finds the tag among the USB serial devices, by what it says it is.

use std::path::{Path, PathBuf};

/// USB vendor of the Loco Positioning Node (INTERFACES.md section 1a).
const VENDOR: &str = "0483";
/// Its product number. Half of all flight controllers use the same, so the name decides.
const PRODUCT: &str = "5740";
/// What it calls itself.
const PRODUCT_NAME: &str = "Loco Positioning Node";

/// Where Linux lists serial devices.
const SYS_TTY: &str = "/sys/class/tty";

/// Device of the first Loco Positioning Node.
pub(super) fn find_tag() -> Option<PathBuf> {
    find_below(Path::new(SYS_TTY))
}

fn find_below(list: &Path) -> Option<PathBuf> {
    let mut names: Vec<_> =
        std::fs::read_dir(list).ok()?.filter_map(|entry| Some(entry.ok()?.file_name())).collect();
    names.sort();
    names
        .into_iter()
        .find(|name| {
            // `device` is the USB interface; what the device says stands one level above.
            let Ok(interface) = list.join(name).join("device").canonicalize() else { return false };
            let Some(device) = interface.parent() else { return false };
            let says = |file: &str| std::fs::read_to_string(device.join(file)).unwrap_or_default();
            says("idVendor").trim() == VENDOR
                && says("idProduct").trim() == PRODUCT
                && says("product").trim() == PRODUCT_NAME
        })
        .map(|name| Path::new("/dev").join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_name_decides_among_equal_numbers() {
        let sys = tempfile::tempdir().unwrap();
        let list = sys.path().join("class");
        let add = |tty: &str, product: &str| {
            let device = sys.path().join("devices").join(tty);
            let interface = device.join("1-1:1.0");
            std::fs::create_dir_all(&interface).unwrap();
            std::fs::write(device.join("idVendor"), "0483\n").unwrap();
            std::fs::write(device.join("idProduct"), "5740\n").unwrap();
            std::fs::write(device.join("product"), product).unwrap();
            let tty = list.join(tty);
            std::fs::create_dir_all(&tty).unwrap();
            std::os::unix::fs::symlink(interface, tty.join("device")).unwrap();
        };
        std::fs::create_dir_all(list.join("tty0")).unwrap();
        add("ttyACM0", "STM32 Virtual ComPort\n");
        assert_eq!(find_below(&list), None);
        add("ttyACM2", "Loco Positioning Node\n");
        add("ttyACM1", "Loco Positioning Node\n");
        assert_eq!(find_below(&list), Some("/dev/ttyACM1".into()));
        assert_eq!(find_below(Path::new("/nowhere")), None);
    }
}
