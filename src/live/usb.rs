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

/// A serial device on USB, and what it says it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsbSerial {
    /// Its device.
    pub device: PathBuf,
    /// Vendor number, four hexadecimal digits.
    pub vendor: String,
    /// Product number, likewise.
    pub product: String,
    /// What it calls itself; may be empty.
    pub name: String,
}

impl UsbSerial {
    /// Whether it says that it is a Loco Positioning Node.
    pub fn is_tag(&self) -> bool {
        self.vendor == VENDOR && self.product == PRODUCT && self.name == PRODUCT_NAME
    }
}

impl std::fmt::Display for UsbSerial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = if self.name.is_empty() { "no name" } else { &self.name };
        write!(f, "{} ({}:{}, {name})", self.device.display(), self.vendor, self.product)
    }
}

/// Every serial device on USB, by name.
pub fn serial_devices() -> Vec<UsbSerial> {
    list_below(Path::new(SYS_TTY))
}

/// Device of the first Loco Positioning Node.
pub(super) fn find_tag() -> Option<PathBuf> {
    serial_devices().into_iter().find(UsbSerial::is_tag).map(|usb| usb.device)
}

fn list_below(list: &Path) -> Vec<UsbSerial> {
    let Ok(entries) = std::fs::read_dir(list) else { return Vec::new() };
    let mut names: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.file_name())).collect();
    names.sort();
    names
        .into_iter()
        .filter_map(|name| {
            let interface = list.join(&name).join("device").canonicalize().ok()?;
            // CDC-ACM hangs on the interface, a converter one level deeper: the first folder upward
            // that has a vendor is the device.
            let mut folders = interface.ancestors().skip(1).take(2);
            let device = folders.find(|folder| folder.join("idVendor").exists())?;
            let says = |file: &str| {
                let text = std::fs::read_to_string(device.join(file)).unwrap_or_default();
                text.trim().to_owned()
            };
            Some(UsbSerial {
                device: Path::new("/dev").join(name),
                vendor: says("idVendor"),
                product: says("idProduct"),
                name: says("product"),
            })
        })
        .collect()
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
        let tags = || {
            let found = list_below(&list).into_iter().filter(UsbSerial::is_tag);
            found.map(|usb| usb.device.display().to_string()).collect::<Vec<_>>()
        };
        assert!(tags().is_empty());
        assert_eq!(
            list_below(&list)[0].to_string(),
            "/dev/ttyACM0 (0483:5740, STM32 Virtual ComPort)"
        );
        add("ttyACM2", "Loco Positioning Node\n");
        add("ttyACM1", "Loco Positioning Node\n");
        assert_eq!(tags(), ["/dev/ttyACM1", "/dev/ttyACM2"]);
        assert!(list_below(Path::new("/nowhere")).is_empty());
    }
}
