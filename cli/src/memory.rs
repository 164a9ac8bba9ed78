//! How much memory the program took at most.

use std::fs;

/// Bytes that were resident at most since the program began, as Linux counts them; none elsewhere.
///
/// It differs from run to run: it is printed, and stands in no file that is to be the same each time.
pub(crate) fn peak() -> Option<u64> {
    high_water(&fs::read_to_string("/proc/self/status").ok()?)
}

fn high_water(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    // The unit is always kB, and stands for 1024 bytes.
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kibibytes| 1024 * kibibytes)
}

/// The same behind other words; empty where it is not known.
pub(crate) fn said(bytes: Option<u64>) -> String {
    match bytes {
        None => String::new(),
        Some(bytes) if bytes < 1_000_000_000 => {
            format!(", peak memory {:.0} MB", bytes as f64 / 1e6)
        }
        Some(bytes) => format!(", peak memory {:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_high_water_mark_is_read() {
        let status = "Name:\tunsphere\nVmPeak:\t  900 kB\nVmHWM:\t  224512 kB\nVmRSS:\t 1 kB\n";
        assert_eq!(high_water(status), Some(229_900_288));
        assert_eq!(said(high_water(status)), ", peak memory 230 MB");
        assert_eq!(said(Some(5_120_000_000)), ", peak memory 5.1 GB");
        assert_eq!(said(high_water("Name:\tunsphere\n")), "");
        assert_eq!(peak().is_some(), cfg!(target_os = "linux"));
    }
}
