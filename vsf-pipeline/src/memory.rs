/// Resident memory of this process, which is not swapped out.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ProcessMemory {
    /// Present value (MB).
    pub resident_mb: f64,
    /// Largest value so far (MB).
    pub peak_mb: f64,
}

impl ProcessMemory {
    /// Reads the values that Linux reports; `None` on other systems.
    pub fn now() -> Option<Self> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mb = |name: &str| -> Option<f64> {
            let line = status.lines().find_map(|l| l.strip_prefix(name))?;
            let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
            Some(kib * 1024.0 * 1e-6)
        };
        Some(Self {
            resident_mb: mb("VmRSS:")?,
            peak_mb: mb("VmHWM:")?,
        })
    }
}
