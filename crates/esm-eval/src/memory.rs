//! Peak memory of this process.

/// Largest resident set so far in MiB, or since `reset_peak`; `None` where the system does not say.
pub fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    peak_of(&status)
}

/// Starts the measurement anew from what is in use now. Does nothing where the system does not offer it.
pub(crate) fn reset_peak() {
    // Linux, proc(5): 5 resets the high-water mark. Elsewhere the peak stays that of the whole run.
    if let Err(error) = std::fs::write("/proc/self/clear_refs", "5") {
        tracing::debug!("the peak memory cannot be measured anew: {error}");
    }
}

fn peak_of(status: &str) -> Option<f64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_high_water_mark_is_read() {
        assert_eq!(peak_of("Name:\tx\nVmHWM:\t  2048 kB\nVmRSS:\t 1 kB\n"), Some(2.0));
        assert_eq!(peak_of("Name:\tx\n"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_process_has_one() {
        assert!(peak_mib().unwrap() > 0.1);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_peak_is_of_what_comes_after_a_reset() {
        let block = vec![1u8; 200 << 20];
        assert!(peak_mib().unwrap() > f64::from(block[12345]) * 200.0);
        drop(block);
        reset_peak();
        assert!(peak_mib().unwrap() < 200.0);
    }
}
